"""What pyproject.toml asks for, and the lowest versions that it allows."""

import tomllib
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]

#: Extras for work on the package itself, which need the checkout.
OF_THE_CHECKOUT = ("dev", "docs", "mutation", "peers")


def project() -> dict:
    """The table `project` of pyproject.toml."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        return tomllib.load(file)["project"]


def extras() -> list[str]:
    """The extras that users install."""
    return [name for name in project()["optional-dependencies"] if name not in OF_THE_CHECKOUT]


def lowest(requirements: list[str], environment: dict[str, str] | None = None) -> Iterator[str]:
    """The requirements with each lower bound as the version; others as they are.

    Those whose marker is false in the environment are left out.

    >>> list(lowest(["torch>=2.4", "hydra-core>=1.3.2,<1.4", "laspy[lazrs]>=2.5.3", "optuna<3"]))
    ['torch==2.4', 'hydra-core==1.3.2', 'laspy[lazrs]==2.5.3', 'optuna<3']
    """
    for text in requirements:
        one = Requirement(text)
        if one.marker is not None and not one.marker.evaluate(environment):
            continue
        brackets = f"[{','.join(sorted(one.extras))}]" if one.extras else ""
        bounds = [part.version for part in one.specifier if part.operator in (">=", "==")]
        yield f"{one.name}{brackets}" + (f"=={bounds[0]}" if bounds else str(one.specifier))


def constrained(file: Path | None) -> set[str]:
    """The names that a file of constraints pins."""
    if file is None:
        return set()
    lines = [line.partition("#")[0].strip() for line in file.read_text("utf-8").splitlines()]
    return {Requirement(line).name.lower() for line in lines if line}
