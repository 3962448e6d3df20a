"""The manifest of a simulated data set: what made it, and whether it is whole."""

import json
from pathlib import Path

from deepring.errors import DeepringError
from deepring.io.files import part_of, write_whole
from deepring.simulation.settings import SimulationSettings

#: Counts changes that alter the bytes of a simulation.
VERSION = 1

NAME = "simulation.json"


def claim(root: Path, settings: SimulationSettings) -> bool:
    """Make ``root`` this simulation's folder. True where it is already whole.

    Raises DeepringError, and touches nothing, where ``root`` holds something else.
    """
    if not _occupied(root):
        _write(root, settings, {}, [])
        return False
    found = _read(root)
    if found is None:
        raise DeepringError(
            f"root = {root} is a non-empty folder without a {NAME}; expected a new or empty "
            f"folder, or an earlier simulation with the same settings. Choose another folder."
        )
    _check_same(found, settings, root)
    return _whole(root, found)


def finish(
    root: Path, settings: SimulationSettings, scans: dict[str, int], poses: list[str]
) -> None:
    """Record that all files are there, relative to ``root``: scans by folder, pose files."""
    _write(root, settings, scans, poses)


def _occupied(root: Path) -> bool:
    if root.exists() and not root.is_dir():
        raise DeepringError(f"root = {root} is a file; expected a folder. Choose another path.")
    unfinished = part_of(root / NAME).name  # all that a run killed at once leaves behind
    return root.is_dir() and any(path.name != unfinished for path in root.iterdir())


def _read(root: Path) -> dict[str, object] | None:
    path = root / NAME
    if not path.is_file():
        return None
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DeepringError(
            f"{path} is not valid JSON ({error}). Delete the folder, or choose another."
        ) from None
    if not isinstance(found, dict) or not isinstance(found.get("settings"), dict):
        raise DeepringError(
            f"{path} is not a simulation's manifest: it has no settings. Choose another folder."
        )
    return found


def _check_same(found: dict[str, object], settings: SimulationSettings, root: Path) -> None:
    old = found["settings"]
    assert isinstance(old, dict)
    new = settings.as_dict()
    differences = [
        f"{name} is {old.get(name)!r} there and {new.get(name)!r} here"
        for name in sorted({*old, *new})
        if old.get(name) != new.get(name)
    ]
    if found.get("version") != VERSION:
        differences.insert(0, f"version is {found.get('version')!r} there and {VERSION} here")
    if differences:
        raise DeepringError(
            f"root = {root} holds a simulation with other settings: {'; '.join(differences)}. "
            f"Nothing was changed. Choose another folder, or the same settings."
        )


def _whole(root: Path, found: dict[str, object]) -> bool:
    """Whether every file that the finished run counted is still there."""
    scans, poses = found.get("scans"), found.get("poses")
    if not isinstance(scans, dict) or not isinstance(poses, list) or not scans:
        return False
    counted = all(len(list((root / f).glob("[!.]*"))) == n for f, n in scans.items())
    return counted and all((root / name).is_file() for name in poses)


def _write(
    root: Path, settings: SimulationSettings, scans: dict[str, int], poses: list[str]
) -> None:
    content = {
        "format": "deepring simulation",
        "version": VERSION,
        "settings": settings.as_dict(),
        "complete": bool(scans),
        "scans": scans,
        "poses": poses,
    }
    data = (json.dumps(content, indent=2) + "\n").encode()
    write_whole(root / NAME, [data])
