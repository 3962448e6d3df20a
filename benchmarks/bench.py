"""How long every stage takes, from points to hits, beside the usual routes.

    python benchmarks/bench.py [--stages scan,cache,search,locate,training] [--most 100000]

One thread. Writes bench.json and bench.md to outputs/bench and prints the table as it grows. With
--device cuda it measures what runs on a GPU. Sizes of maps are 1k, 10k, 100k and 1M places, up to
--most; a million needs some 4 GB.
"""

import argparse
import dataclasses
import json
import sys
from collections.abc import Iterator
from pathlib import Path

from deepring.cli.process import tune_process

tune_process()

import torch  # noqa: E402
from timing import Row, bandwidth, machine  # noqa: E402

SIZES = (1_000, 10_000, 100_000, 1_000_000)
STAGES = ("scan", "cache", "search", "locate", "training")

#: What the ratios below the table are of: the faster, the slower, their number of things.
RATIOS = (
    ("scan to sinogram, height band", "peer: scan to sinogram, NumPy and scikit-image", 70_000),
    ("scan to sinogram, ground removed", "peer: scan to sinogram, NumPy and scikit-image", 70_000),
    ("BEV to sinogram", "peer: BEV to sinogram, scikit-image", 70_000),
    ("exact search, float32, 1 query", "peer: RING's published correlation, torch", 10_000),
    ("exact search, float32, 64 queries", "peer: RING's published correlation, torch", 10_000),
    ("exact search, int8, 1 query", "peer: RING's published correlation, torch", 10_000),
    ("exact search, int8, 64 queries", "peer: RING's published correlation, torch", 10_000),
)


def measure(stages: list[str], runs: int, most: int, device: str) -> Iterator[Row]:
    """All rows that are asked for, one after the other."""
    import localization_stages
    import scan_stages
    import search_stages
    import training_stages

    sizes = tuple(size for size in SIZES if size <= most)
    if device != "cpu":
        if "scan" in stages:
            yield from scan_stages.gpu_stages(runs)
        if "search" in stages:
            yield from search_stages.exact_stages(runs, sizes[:3], device)
        if "training" in stages:
            yield from training_stages.training_stages(runs, device)
        return
    if "scan" in stages:
        yield from scan_stages.scan_stages(runs)
    if "cache" in stages:
        yield from scan_stages.cache_stages(runs)
    if "search" in stages:
        yield from search_stages.published_stage(runs)
        yield from search_stages.exact_stages(runs, sizes[:3])
        yield from search_stages.two_stage(runs, sizes)
        yield from search_stages.network_stage(runs)
        yield from search_stages.context_stage(runs, sizes[:3])
        yield from search_stages.vector_stage(runs, sizes[:3])
    if "locate" in stages:
        yield from localization_stages.locate_stages(runs, min(10_000, most))
    if "training" in stages:
        yield from training_stages.training_stages(runs)


def ratios(rows: list[Row]) -> list[str]:
    """How many times faster, where both were measured, and whether targets are reached."""
    from localization_stages import targets

    lines = targets(rows)
    for fast, slow, n in RATIOS:
        times = {row.what: row.median for row in rows if row.n == n}
        if fast in times and slow in times:
            lines.append(f"- {fast}: {times[slow] / times[fast]:.0f} times as fast as {slow}")
    return lines


def formatted(row: Row) -> str:
    scale, unit = next(
        (
            (scale, unit)
            for scale, unit in ((1, "s"), (1e3, "ms"), (1e6, "µs"))
            if row.median * scale >= 1
        ),
        (1e9, "ns"),
    )
    low, median, high = (f"{value * scale:.3g}" for value in (row.low, row.median, row.high))
    note = f" {row.note}" if row.note else ""
    return f"| {row.what} | {row.n:,} | {median} {unit} | {low} - {high} | {row.per} |{note} |"


HEAD = "| stage | points or places | median | IQR | a | |\n| --- | ---: | ---: | ---: | --- | --- |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stages", default=",".join(STAGES))
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--most", type=int, default=100_000, help="places in the largest map")
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu")
    parser.add_argument("-o", "--output", type=Path, default=Path("outputs/bench"))
    args = parser.parse_args()
    stages = args.stages.split(",")
    if unknown := set(stages) - set(STAGES):
        parser.error(f"--stages: {sorted(unknown)}, expected some of {', '.join(STAGES)}")
    if args.device == "cuda" and not torch.cuda.is_available():
        parser.error("--device cuda: torch sees no GPU here")
    torch.set_num_threads(1)

    about = machine(1, args.device if args.device == "cpu" else torch.cuda.get_device_name())
    about["bytes_per_second"] = round(bandwidth(args.device))
    print(", ".join(f"{name} {value}" for name, value in about.items()), "\n")
    print(HEAD, flush=True)
    rows = []
    try:
        for row in measure(stages, args.runs, args.most, args.device):
            rows.append(row)
            print(formatted(row), flush=True)
    except KeyboardInterrupt:
        print("interrupted; what was measured is written", file=sys.stderr)
    summary = ratios(rows)
    print("", *summary, sep="\n")
    args.output.mkdir(parents=True, exist_ok=True)
    name = "bench" if args.device == "cpu" else "bench_cuda"
    everything = {"machine": about, "rows": [dataclasses.asdict(row) for row in rows]}
    (args.output / f"{name}.json").write_text(json.dumps(everything, indent=1))
    text = [
        ", ".join(f"{k} {v}" for k, v in about.items()),
        "",
        HEAD,
        *map(formatted, rows),
        "",
        *summary,
    ]
    (args.output / f"{name}.md").write_text("\n".join(text) + "\n")
    print(f"\nwritten      {args.output / name}.json, {args.output / name}.md")


if __name__ == "__main__":
    main()
