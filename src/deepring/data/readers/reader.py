"""The base of readers: a dataset layout, and helpers to find folders."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deepring.data.session import Points, Session
from deepring.errors import DataError


class BinaryScans(NamedTuple):
    """A format of .bin files, which the files themselves do not name."""

    read: Callable[[Path | str], Points]
    """Decodes one file, missing returns included; raises BrokenScanError."""
    records: tuple[np.dtype, ...]
    """Types of point records; a file consists of records of one of them."""
    ground_z: float
    """z of the ground under the sensor in the scan's frame, metres, on the usual platform."""


@dataclass(frozen=True)
class Reader:
    """One dataset layout.

    Each layout's module in this package ends in ``READER = Reader(...)`` with the module's name;
    see `deepring.data.readers.register_reader` for layouts of other packages.
    """

    name: str
    """Name of the layout, ``format`` in `open_session` and in a data config."""
    title: str
    """Name of the layout in messages and docs."""
    layouts: tuple[str, ...]
    """Accepted folder layouts, one line each, for messages."""
    open: Callable[..., Session]
    """open(root, name, **options) -> the session of that name."""
    sessions: Callable[[Path | str], list[str]]
    """sessions(root) -> the names of the sessions in order, possibly none."""
    signatures: tuple[str, ...] = ()
    """Patterns of file and folder names that identify the layout; see `detect_format`."""
    resembles: tuple[str, ...] = ()
    """Layouts whose signatures occur in this one too; this one wins if both match."""
    scan_folders: tuple[str, ...] = ()
    """Names of folders with very many scans, which `detect_format` does not search."""
    file_endings: tuple[str, ...] = ()
    """Endings of files that describe a dataset, instead of a folder."""
    scans: Mapping[str, BinaryScans] = field(default_factory=dict)
    """Formats of .bin files of this layout, by name."""

    @property
    def ground_z(self) -> float | None:
        """z of the ground in the scans' frame, metres; None if it depends on the session."""
        heights = {scans.ground_z for scans in self.scans.values()}
        return heights.pop() if len(heights) == 1 else None


class LayoutError(DataError):
    """A folder without the files of a layout; `open_session` adds the accepted layouts."""

    def __init__(self, problem: str, root: Path | str) -> None:
        super().__init__(f"{problem} (looked in {root})")
        self.root = Path(root)


def existing_root(root: Path | str) -> Path:
    """``root`` as an absolute path. Raises DataError if it is not a folder."""
    folder = Path(root).expanduser().absolute()
    if ".." in folder.parts:
        folder = folder.resolve()
    if not folder.is_dir():
        state = "is a file" if folder.exists() else "does not exist"
        raise DataError(
            f"root: {folder} {state}; expected the folder of a dataset, or a drive.yaml"
        )
    return folder


def first_folder(candidates: Iterable[Path]) -> Path | None:
    """The first candidate that is a folder, or None."""
    return next((path for path in candidates if path.is_dir()), None)


def first_file(candidates: Iterable[Path]) -> Path | None:
    """The first candidate that is a file, or None."""
    return next((path for path in candidates if path.is_file()), None)
