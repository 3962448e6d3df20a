"""Names of scan files: which entries of a folder may be scans, and in which order."""

import os
import re
from collections.abc import Collection
from decimal import Decimal
from pathlib import Path

_NUMBER = re.compile(r"([0-9]+(?:\.[0-9]+)?)")


def ending_of(path: Path) -> str:
    """The ending of a file's name in lower case, e.g. ".pcd"."""
    return path.suffix.lower()


def is_visible(name: str) -> bool:
    """False for the names of files that systems and programs leave beside others.

    macOS adds ``._NAME`` to each file that it unpacks, and ``.DS_Store``; downloads and copies that
    are not complete are hidden, too; editors keep copies as ``~NAME``.
    """
    return not name.startswith((".", "~"))


def files_with(folder: Path, endings: Collection[str]) -> list[Path]:
    """The visible files of a folder with one of the endings, in any case, in `name_order`.

    Broken links are included, folders are not.
    """
    with os.scandir(folder) as entries:
        files = [
            folder / entry.name
            for entry in entries
            if is_visible(entry.name)
            and ending_of(Path(entry.name)) in endings
            and not entry.is_dir()
        ]
    return sorted(files, key=name_order)


def visible_folders(folder: Path) -> list[Path]:
    """The visible folders in a folder, sorted by name."""
    return sorted(path for path in folder.iterdir() if is_visible(path.name) and path.is_dir())


def name_order(file: Path) -> tuple[list[str | Decimal], str]:
    """Sort key with numbers in names as numbers, so that 9.npy comes before 10.npy."""
    parts = _NUMBER.split(file.stem)
    return [Decimal(part) if k % 2 else part for k, part in enumerate(parts)], file.name
