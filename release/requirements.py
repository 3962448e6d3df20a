"""What pyproject.toml asks for, and the lowest versions that it allows."""

import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

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


def of_users(names: Iterable[str]) -> list[str]:
    """The requirements of the package and of extras; not the tools of those for the checkout.

    Extras within those of the names are among them.
    """
    described = project()
    optional, base = described["optional-dependencies"], described["dependencies"]
    known = {Requirement(text).name for text in base}

    def of(name: str) -> Iterator[str]:
        for text in optional[name]:
            one = Requirement(text)
            if one.name == described["name"]:
                for other in sorted(one.extras):
                    yield from of(other)
            elif name not in OF_THE_CHECKOUT or one.name in known:
                yield text

    return [*base, *(text for name in names for text in of(name))]


def lowest(requirements: Iterable[str], environment: dict[str, str] | None = None) -> list[str]:
    """Each package with its lower bound as the version; the highest where several are asked for.

    Those whose marker is false in the environment are left out. One without a lower bound is as it
    is.

    >>> lowest(["torch>=2.4", "hydra-core>=1.3.2,<1.4", "laspy[lazrs]>=2.5.3", "torch>=2.6", "six"])
    ['torch==2.6', 'hydra-core==1.3.2', 'laspy[lazrs]==2.5.3', 'six']
    """
    found: dict[str, Requirement] = {}
    for text in requirements:
        one = Requirement(text)
        if one.marker is not None and not one.marker.evaluate(environment):
            continue
        other = found.setdefault(canonicalize_name(one.name), one)
        other.extras |= one.extras
        other.specifier &= one.specifier
    return [_at_lower_bound(one) for one in found.values()]


def _at_lower_bound(one: Requirement) -> str:
    brackets = f"[{','.join(sorted(one.extras))}]" if one.extras else ""
    bounds = [part.version for part in one.specifier if part.operator in (">=", "==")]
    version = f"=={max(bounds, key=Version)}" if bounds else str(one.specifier)
    return f"{one.name}{brackets}{version}"


def constrained(file: Path | None) -> set[str]:
    """The names that a file of constraints pins."""
    if file is None:
        return set()
    lines = [line.partition("#")[0].strip() for line in file.read_text("utf-8").splitlines()]
    return {Requirement(line).name.lower() for line in lines if line}
