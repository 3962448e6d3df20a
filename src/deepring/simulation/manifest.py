"""The manifest of a simulated data set: what made it, and whether it is whole."""

import json
from pathlib import Path

from deepring.errors import FileError
from deepring.io.files import part_of, write_whole
from deepring.simulation.settings import SimulationSettings

#: Counts changes that alter the bytes of a simulation.
VERSION = 1

NAME = "simulation.json"


def claim(root: Path, settings: SimulationSettings) -> bool:
    """Make ``root`` this simulation's folder. True where it is already whole.

    Raises FileError, and touches nothing, where ``root`` holds something else.
    """
    if not _occupied(root):
        _write(root, settings, {}, [])
        return False
    content = _read(root)
    if content is None:
        raise FileError(
            f"root: {root} is a non-empty folder without a {NAME}; expected a new or empty "
            f"folder, or an earlier simulation with the same settings. Choose another folder."
        )
    _check_same(content, settings, root)
    return _whole(root, content)


def finish(
    root: Path, settings: SimulationSettings, scans: dict[str, int], poses: list[str]
) -> None:
    """Record that all files are there, relative to ``root``: scans by folder, pose files."""
    _write(root, settings, scans, poses)


def _occupied(root: Path) -> bool:
    if root.exists() and not root.is_dir():
        raise FileError(f"root: {root} is a file; expected a folder. Choose another path.")
    unfinished = part_of(root / NAME).name  # all that a run killed at once leaves behind
    return root.is_dir() and any(path.name != unfinished for path in root.iterdir())


def _read(root: Path) -> dict[str, object] | None:
    path = root / NAME
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        raise FileError(
            f"{path}: no JSON; expected a simulation's manifest. Delete the folder, or choose "
            "another"
        ) from None
    if not isinstance(content, dict) or not isinstance(content.get("settings"), dict):
        raise FileError(
            f"{path} is not a simulation's manifest: it has no settings. Choose another folder."
        )
    return content


def _check_same(content: dict[str, object], settings: SimulationSettings, root: Path) -> None:
    old = content["settings"]
    assert isinstance(old, dict)
    new = settings.as_dict()
    differences = [
        f"{name} is {old.get(name)!r} there and {new.get(name)!r} here"
        for name in sorted({*old, *new})
        if old.get(name) != new.get(name)
    ]
    if content.get("version") != VERSION:
        differences.insert(0, f"version is {content.get('version')!r} there and {VERSION} here")
    if differences:
        raise FileError(
            f"root: {root} holds a simulation with other settings: {'; '.join(differences)}. "
            f"Nothing was changed. Choose another folder, or the same settings."
        )


def _whole(root: Path, content: dict[str, object]) -> bool:
    """True where every file that the finished run counted is still there."""
    scans, poses = content.get("scans"), content.get("poses")
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
