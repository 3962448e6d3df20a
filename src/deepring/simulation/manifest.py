"""The manifest of a simulated dataset: its settings, and whether it is complete."""

import json
from pathlib import Path, PurePath

from deepring.errors import FileError
from deepring.io.files import part_of, write_whole
from deepring.simulation.presets import preset
from deepring.simulation.settings import SimulationSettings
from deepring.text import shown

#: Increases with each change that alters the bytes of a simulation.
VERSION = 1

NAME = "simulation.json"

#: Settings that differ, in a message.
_MOST_NAMED = 6


def claim(root: Path, settings: SimulationSettings) -> bool:
    """Make ``root`` the folder of this simulation. True if it is already complete.

    Raises FileError, without changing anything, if ``root`` holds other data.
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
    return _complete(root, content)


def finish(
    root: Path, settings: SimulationSettings, scans: dict[str, int], poses: list[str]
) -> None:
    """Record the complete files, relative to ``root``: numbers of scans by folder, pose files."""
    _write(root, settings, scans, poses)


def _occupied(root: Path) -> bool:
    if root.exists() and not root.is_dir():
        raise FileError(f"root: {root} is a file; expected a folder. Choose another path.")
    part = part_of(root / NAME).name  # all that a run leaves if it is killed at the start
    return root.is_dir() and any(path.name != part for path in root.iterdir())


def _read(root: Path) -> dict[str, object] | None:
    path = root / NAME
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        raise FileError(
            f"{path}: not JSON, expected the manifest of a simulation. Delete the folder, or "
            "choose another"
        ) from None
    if not isinstance(content, dict) or not isinstance(content.get("settings"), dict):
        raise FileError(
            f"{path}: no settings, expected the manifest of a simulation. Choose another folder."
        )
    return content


def _check_same(content: dict[str, object], settings: SimulationSettings, root: Path) -> None:
    old = content["settings"]
    assert isinstance(old, dict)
    if old.get("layout") == settings.layout:  # a manifest from before a setting has its default
        old = preset(settings.layout).as_dict() | old
    new = settings.as_dict()
    differences = [
        f"{name} is {shown(old.get(name))} there and {shown(new.get(name))} here"
        for name in sorted({*old, *new})
        if old.get(name) != new.get(name)
    ]
    if content.get("version") != VERSION:
        differences.insert(
            0, f"version is {shown(content.get('version'))} there and {VERSION} here"
        )
    if len(differences) > _MOST_NAMED:
        rest = len(differences) - _MOST_NAMED
        differences[_MOST_NAMED:] = [f"and {rest} more"]
    if differences:
        raise FileError(
            f"root: {root} holds a simulation with other settings: {'; '.join(differences)}. "
            f"Nothing was changed. Choose another folder, or the same settings."
        )


def _complete(root: Path, content: dict[str, object]) -> bool:
    """True if all files of the finished run still exist."""
    scans, poses = content.get("scans"), content.get("poses")
    if not isinstance(scans, dict) or not isinstance(poses, list) or not scans:
        return False
    if not all(isinstance(name, str) and _is_inside(name) for name in (*scans, *poses)):
        return False
    equal = all(len(list((root / f).glob("[!.]*"))) == n for f, n in scans.items())
    return equal and all((root / name).is_file() for name in poses)


def _is_inside(name: str) -> bool:
    """Whether a path of the manifest stays within its folder."""
    path = PurePath(name)
    sound = "\0" not in name and 0 < len(name) < 255
    return sound and not path.is_absolute() and ".." not in path.parts


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
