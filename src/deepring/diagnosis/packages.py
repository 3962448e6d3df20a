"""The packages that deepring needs, and those of its extras: which are installed, and fit."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata

from packaging.requirements import Requirement

from deepring.diagnosis.trouble import Trouble

#: Extras for work on deepring itself.
_FOR_DEVELOPERS = ("dev", "docs", "mutation", "peers")


@dataclass(frozen=True)
class Package:
    """A package that is asked for."""

    name: str
    required: str
    """Versions that fit, as ``>=2.4``; empty for any."""
    version: str | None
    """The installed one; None where there is none."""
    fits: bool


@dataclass(frozen=True)
class Packages:
    """What the metadata of deepring ask for, and what is there."""

    known: bool
    """Whether deepring has metadata, as an installed package has."""
    required: Sequence[Package]
    extras: dict[str, Sequence[Package]]

    def troubles(self) -> Iterator[Trouble]:
        """Packages that are missing or do not fit; those of an extra only if they are there."""
        if not self.known:
            yield Trouble(
                "packages",
                "deepring runs without being installed, so that its requirements are not known",
                "run pip install . in its folder",
            )
        for package in self.required:
            if not package.fits:
                yield _misfit(package, fails=True)
        for of_extra in self.extras.values():
            for package in of_extra:
                if package.version is not None and not package.fits:
                    yield _misfit(package, fails=False)


def find_packages() -> Packages:
    """Look the requirements of deepring up among the installed packages."""
    try:
        lines = metadata.requires("deepring") or []
    except metadata.PackageNotFoundError:
        return Packages(False, (), {})
    every = [one for one in map(Requirement, lines) if one.name != "deepring"]
    names = metadata.metadata("deepring").get_all("Provides-Extra") or []
    extras = sorted(set(names) - set(_FOR_DEVELOPERS))
    needed = [one for one in every if one.marker is None or one.marker.evaluate({"extra": ""})]
    return Packages(
        True,
        [_found(one) for one in needed],
        {extra: [_found(one) for one in every if _is_of(one, extra)] for extra in extras},
    )


def _is_of(requirement: Requirement, extra: str) -> bool:
    """Whether an extra brings the package, which is not needed without it."""
    marker = requirement.marker
    if marker is None or marker.evaluate({"extra": ""}):
        return False
    return marker.evaluate({"extra": extra})


def _found(requirement: Requirement) -> Package:
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        version = None
    fits = version is not None and requirement.specifier.contains(version, prereleases=True)
    return Package(requirement.name, str(requirement.specifier), version, fits)


def _misfit(package: Package, *, fails: bool) -> Trouble:
    wanted = f"{package.name}{package.required}"
    is_there = f"is {package.version}" if package.version else "is missing"
    return Trouble(
        "packages",
        f"{package.name} {is_there}, expected {wanted}",
        f"run pip install '{wanted}'",
        fails,
    )
