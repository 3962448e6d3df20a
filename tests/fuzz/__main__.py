"""Run the suite, or one input of it: `python -m fuzz --inputs 20000 --seeds 0 1 2`."""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from fuzz import report
from fuzz.files import written
from fuzz.inputs import Bench, Name, mutated, names
from fuzz.limits import Limits
from fuzz.outcomes import GOOD
from fuzz.processes import run_all


def main(argv: Sequence[str] | None = None, source: str = "fuzz.formats") -> int:
    """The number of faults is printed last; with any, the exit status is 1."""
    args = _parser().parse_args(argv)
    limits = Limits(args.seconds, args.megabytes << 20)
    every = import_module(source).every_format()
    formats = [f for f in every if not args.formats or _named(f.name, args.formats)]
    if args.list:
        print("\n".join(format.name for format in formats))
        return 0
    with tempfile.TemporaryDirectory(prefix="deepring-fuzz-") as folder:
        if args.input:
            return _one(Name.parse(args.input), formats, Path(folder), limits, args)
        inputs = [name for seed in args.seeds for name in names(formats, seed, args.inputs)]
        start, results = time.monotonic(), []
        for result in run_all(source, inputs, Path(folder), limits, args.processes):
            results.append(result)
            if len(results) % 1000 == 0:
                print(
                    f"{len(results)} of {len(inputs)}, {report.bad(results)} bad", file=sys.stderr
                )
    # They come in the order of the processes.
    order = {name: k for k, name in enumerate(inputs)}
    results.sort(key=lambda result: order[result[0]])
    print(report.table(results))
    if report.bad(results) or args.also:
        print("\nOne again: python -m fuzz --input 'FORMAT:SEED:NUMBER' (--keep FOLDER)\n")
        print(report.faults(results, args.also))
    print(f"\n{report.bad(results)} bad of {len(results)}, {time.monotonic() - start:.0f} s")
    return int(report.bad(results) > 0)


def _one(name: Name, formats: list, folder: Path, limits: Limits, args: argparse.Namespace) -> int:
    (format,) = [f for f in formats if f.name == name.format]
    bench = Bench(format, folder / "one", limits)
    if args.keep:
        written(args.keep, mutated(format, name, bench.good)[0])
        print(f"its files: {args.keep}")
    if args.trace:
        written(bench.folder, mutated(format, name, bench.good)[0])
        print(format.use(bench.folder))
        return 0
    outcome, done = bench.run(name)
    print(report.one(name, outcome, done))
    return int(outcome.is_bad)


def _named(name: str, parts: Sequence[str]) -> bool:
    return any(part in name for part in parts)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=20_000, help="number for each seed")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--formats", nargs="+", default=[], help="only those with such a part")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=Limits.seconds)
    parser.add_argument("--megabytes", type=int, default=Limits.bytes >> 20)
    parser.add_argument("--input", metavar="FORMAT:SEED:NUMBER", help="run this one alone")
    parser.add_argument("--also", nargs="+", default=[], choices=GOOD, help="show these as well")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="write its files there")
    parser.add_argument("--trace", action="store_true", help="let its error end the program")
    parser.add_argument("--list", action="store_true", help="print the names of the formats")
    return parser


if __name__ == "__main__":
    sys.exit(main())
