"""`python -m release`: build, install and use a release in empty environments; one table."""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from release import distributions, interpreters
from release.environment import CommandError, Environment
from release.outcome import NOT_CHECKED, PASSED, Outcome, status, table
from release.requirements import OF_THE_CHECKOUT, constrained, extras, lowest, project
from release.trials import TRIALS, smoke

NEWEST, LOWEST = "newest", "lowest"
_PARTS = ("files", "pythons", "lowest", "extras", "together", "checkout")


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
        "versions, each extra alone, all together, extras for work on the checkout (all)",
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
        yield from _of_python(args, parts, folder, version, interpreter, wheel)


def _of_python(
    args: argparse.Namespace,
    parts: Sequence[str],
    folder: Path,
    version: str,
    interpreter: Path,
    wheel: Path,
) -> Iterator[Outcome]:
    if "lowest" in parts:
        yield _lowest(args, folder / f"lowest{version}", version, interpreter, wheel)
    if not {"pythons", "extras", "together", "checkout"} & set(parts):
        return
    plain = Environment(folder / version)
    try:

        def first() -> None:
            plain.make(interpreter)
            plain.install(str(wheel), constraints=args.constraint)
            smoke(plain)

        outcome = _tried(version, NEWEST, "without extras", plain, first)
        yield outcome
        if outcome.result != PASSED:
            return
        mine = [name for name in args.extras if name not in OF_THE_CHECKOUT]
        groups = [[name] for name in mine] if "extras" in parts else []
        groups += [mine] if "together" in parts else []
        if "checkout" in parts:
            groups += [[name] for name in args.extras if name in OF_THE_CHECKOUT]
        for group in groups:
            yield _with_extras(args, folder / "extra", version, plain, wheel, group)
    finally:
        plain.delete()


def _with_extras(
    args: argparse.Namespace,
    folder: Path,
    version: str,
    plain: Environment,
    wheel: Path,
    names: list[str],
) -> Outcome:
    """What extras are for, in a copy of an environment without any."""
    environment = Environment(folder)

    def trial() -> None:
        environment.copy(plain)
        asked = f"deepring[{','.join(names)}] @ {wheel.as_uri()}"
        environment.install(asked, constraints=args.constraint)
        for name in names:
            _named(name, TRIALS[name], environment)

    try:
        return _tried(version, NEWEST, _title(names), environment, trial)
    finally:
        environment.delete()


def _lowest(
    args: argparse.Namespace, folder: Path, version: str, interpreter: Path, wheel: Path
) -> Outcome:
    """The lowest versions that pyproject.toml allows, with all extras of users."""
    environment, pinned = Environment(folder), constrained(args.constraint)
    names = [name for name in extras() if name in args.extras]
    described = project()
    asked = [*described["dependencies"]]
    for name in names:
        asked += described["optional-dependencies"][name]
    bounds = [one for one in lowest(asked) if one.partition("==")[0].lower() not in pinned]

    def trial() -> None:
        environment.make(interpreter)
        environment.install(str(wheel), *bounds, constraints=args.constraint)
        smoke(environment)
        for name in names:
            _named(name, TRIALS[name], environment)

    versions = LOWEST + "".join(f" but {name}" for name in sorted(pinned))
    try:
        return _tried(version, versions, _title(names), environment, trial)
    finally:
        environment.delete()


def _named(name: str, trial: Callable[[Environment], None], environment: Environment) -> None:
    try:
        trial(environment)
    except CommandError as error:
        raise CommandError(f"{name}: {error}") from error


def _tried(
    python: str, versions: str, what: str, environment: Environment, trial: Callable[[], None]
) -> Outcome:
    start, result, installed = time.monotonic(), PASSED, ""
    try:
        trial()
        installed = environment.versions()
    except CommandError as error:
        print(error, file=sys.stderr)
        result = f"failed: {str(error).partition(chr(10))[0][:120]}"
    return Outcome(python, versions, what, result, time.monotonic() - start, installed)


def _title(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{len(names)} extras together"


if __name__ == "__main__":
    main()
