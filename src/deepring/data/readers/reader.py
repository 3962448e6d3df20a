"""The description of a reader of one dataset layout, and helpers to find its folders."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deepring.data.session import Points, Session
from deepring.errors import DataError


class BinaryScans(NamedTuple):
    """One kind of .bin files: how to read them, which the files themselves do not say."""

    read: Callable[[Path | str], Points]
    """Decodes one file; raises BrokenScanError."""
    records: tuple[np.dtype, ...]
    """The types of a point record; a file is a whole number of records of one of them."""
    ground_z: float
    """z of the ground under the sensor in the scan's frame, metres, on the usual platform."""


@dataclass(frozen=True)
class Reader:
    """One dataset layout: everything that names it or depends on it.

    Each layout's module in this package ends in ``READER = Reader(...)``, named as the module;
    see `deepring.data.readers.register_reader` for one from outside.
    """

    name: str
    """The name of the layout: ``format`` of `open_session` and of a data config."""
    title: str
    """The layout's name in messages and docs."""
    layouts: tuple[str, ...]
    """The folder layouts that are accepted, one line each, for messages."""
    open: Callable[..., Session]
    """open(root, name, **options) -> the session of that name."""
    sessions: Callable[[Path | str], list[str]]
    """sessions(root) -> the sessions' names in order; empty where there is none."""
    signatures: tuple[str, ...] = ()
    """Patterns of file and folder names that give the layout away; see `detect_format`."""
    resembles: tuple[str, ...] = ()
    """Layouts whose signatures occur in this one too; this one is meant where both are met."""
    scan_folders: tuple[str, ...] = ()
    """Names of folders with tens of thousands of scans, which no search descends into."""
    file_endings: tuple[str, ...] = ()
    """Endings of the files that stand for a dataset in place of a folder."""
    scans: Mapping[str, BinaryScans] = field(default_factory=dict)
    """The kinds of .bin files of this layout, by the names that users give them."""

    @property
    def ground_z(self) -> float | None:
        """z of the ground in the scans' frame, metres; None where each session says it itself."""
        heights = {scans.ground_z for scans in self.scans.values()}
        return heights.pop() if len(heights) == 1 else None


class LayoutError(DataError):
    """A folder that lacks what a reader needs; `open_session` adds which layouts are accepted."""

    def __init__(self, problem: str, root: Path | str) -> None:
        super().__init__(f"{problem} (looked in {root})")
        self.root = Path(root)


def existing_root(root: Path | str) -> Path:
    """``root`` as an absolute path. Raises DataError where it is no folder."""
    folder = Path(root).expanduser().absolute()
    if ".." in folder.parts:
        folder = folder.resolve()
    if not folder.is_dir():
        state = "is a file" if folder.exists() else "does not exist"
        raise DataError(f"root: {folder} {state}; expected the folder that holds the dataset")
    return folder


def first_folder(candidates: Iterable[Path]) -> Path | None:
    """The first candidate that is a folder, or None."""
    return next((path for path in candidates if path.is_dir()), None)


def first_file(candidates: Iterable[Path]) -> Path | None:
    """The first candidate that is a file, or None."""
    return next((path for path in candidates if path.is_file()), None)
