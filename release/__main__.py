"""`python -m release`: build, install and use a release in empty environments; one table."""

import argparse
import sys
import tempfile
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from release import distributions, interpreters
from release.outcome import NOT_CHECKED, Outcome, status, table
from release.requirements import OF_THE_CHECKOUT
from release.series import LOWEST, NEWEST, Group, Series
from release.trials import TRIALS, suite

_PARTS = ("files", "pythons", "lowest", "tests", "extras", "together", "checkout")


def arguments(words: Sequence[str] | None = None) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(prog="python -m release", description=__doc__)
    parser.add_argument("--pythons", nargs="+", default=["3.11", "3.12", "3.13"], metavar="3.X")
    parser.add_argument(
        *("--parts", "--part"),
        nargs="+",
        choices=_PARTS,
        default=_PARTS,
        help="files: wheel and sdist; pythons: newest versions on each; and on the first: lowest "
        "versions without and with each extra and all, tests of the checkout with the lowest, each "
        "extra alone, all together, extras for work on the checkout (all)",
    )
    parser.add_argument("--extras", nargs="+", choices=TRIALS, default=list(TRIALS))
    parser.add_argument(
        "--constraint", type=_resolved, help="pip's -c; what it pins is never lowered"
    )
    parser.add_argument("--folder", type=_made, help="where environments are made and deleted")
    return parser.parse_args(words)


def _resolved(text: str) -> Path:
    return Path(text).resolve()


def _made(text: str) -> Path:
    folder = Path(text)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        raise argparse.ArgumentTypeError(
            f"{text}: expected a folder that is there or can be made; give another one"
        ) from None
    return folder


def main() -> None:
    """Check what was asked for; exit with 0 only if all of it was checked and passed."""
    args = arguments()
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory(prefix="release-", dir=args.folder) as folder:
        for outcome in _outcomes(args, Path(folder).resolve()):
            outcomes.append(outcome)
            line = f"{outcome.python} {outcome.versions}, {outcome.what}: {outcome.result}"
            print(line, file=sys.stderr, flush=True)
    print(table(outcomes))
    sys.exit(status(outcomes))


def _outcomes(args: argparse.Namespace, folder: Path) -> Iterator[Outcome]:
    files = distributions.build(folder / "dist")
    wheel = distributions.wheel_of(files)
    if "files" in args.parts:
        python = f"{sys.version_info.major}.{sys.version_info.minor}"
        for what, result in distributions.check(files, folder / "sdist"):
            yield Outcome(python, "-", what, result)
    for version in args.pythons:
        interpreter = interpreters.find(version)
        parts = args.parts if version == args.pythons[0] else [*{"pythons"} & {*args.parts}]
        if interpreter is None:
            if parts:
                yield Outcome(version, "-", ", ".join(parts), f"{NOT_CHECKED}: no interpreter")
            continue
        for versions, groups in series(parts, args.extras):
            one = Series(version, interpreter, wheel, args.constraint, versions)
            yield from one.outcomes(folder / versions, groups)


def series(parts: Collection[str], extras: Sequence[str]) -> Iterator[tuple[str, list[Group]]]:
    """LOWEST and NEWEST, if the parts ask for them, each with groups of the extras."""
    users = [name for name in extras if name not in OF_THE_CHECKOUT]
    alone, together = [Group.of([name]) for name in users], [Group.of(users)]
    checkout = [Group.of([name]) for name in extras if name in OF_THE_CHECKOUT]
    groups = {
        "lowest": [*alone, *together],
        "tests": [Group(["dev"], {"the tests of the checkout": suite})],
        "pythons": [],
        "extras": alone,
        "together": together,
        "checkout": checkout,
    }
    for versions, mine in (
        (LOWEST, ("lowest", "tests")),
        (NEWEST, ("pythons", "extras", "together", "checkout")),
    ):
        asked = [part for part in mine if part in parts]
        if asked:
            yield versions, [group for part in asked for group in groups[part]]


if __name__ == "__main__":
    main()
