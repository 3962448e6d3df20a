"""A session: scans, stamps and poses of one drive. Points are read one scan at a time."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.columns import PointColumn, label_path
from deepring.data.scans.returns import Scan, scan_from
from deepring.errors import BrokenScanError, DataError

Points = NDArray[np.float32]
"""(n, 3) float32, metres, in the scan's own frame: right-handed, z up."""


@dataclass(frozen=True)
class SkippedScans:
    """The scans that a reader skipped, with reasons; always logged."""

    broken: tuple[str, ...] = ()  # files that cannot be decoded, each with its reason
    without_pose: int = 0  # scans farther than the tolerance from any pose
    bad_poses: int = 0  # pose rows with NaN or a repeated stamp (dropped), or out of order

    def __str__(self) -> str:
        """One line, empty if nothing was skipped."""
        parts = []
        if self.broken:
            parts.append(f"{len(self.broken)} broken files (first: {self.broken[0]})")
        if self.without_pose:
            parts.append(f"{self.without_pose} scans without a pose")
        if self.bad_poses:
            parts.append(f"{self.bad_poses} bad pose rows")
        return ", ".join(parts)


@dataclass(frozen=True, eq=False)
class Session:
    """One drive: n scans with poses, in driving order. Points are not kept in memory.

    ``poses`` are (n, 4, 4) float64, world <- scan frame, world z up. ``ground_truth`` are
    (n, 2) float64, the planar coordinates of the dataset's own ground truth (NCLT: north, east;
    MulRan: easting, northing), which regions refer to. ``stamps`` are (n,)
    int64 nanoseconds, or None without time stamps. ``read`` decodes one file and raises
    BrokenScanError if it cannot; its (n, 3) may contain missing returns, which `scan` drops.
    """

    name: str
    files: tuple[Path, ...]
    poses: NDArray[np.float64]
    ground_truth: NDArray[np.float64]
    stamps: NDArray[np.int64] | None
    read: Callable[[Path], Points]
    skipped: SkippedScans = field(default_factory=SkippedScans)
    axes: tuple[str, str] = ("x", "y")  # names of the two ground-truth coordinates
    ground_z: float | None = None  # of the ground in the scans' frame, if the session has it
    #: Name of the decoding, for the raster cache: changes with the points of a file, but not when
    #: code moves. None uses the name of the function, or the settings of the object.
    decoding: str | None = None
    #: What the files say of each point beside its coordinates, by name: "label", "intensity".
    columns: Mapping[str, PointColumn] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.files)
        if self.poses.shape != (n, 4, 4) or self.ground_truth.shape != (n, 2):
            raise DataError(
                f"session {self.name}: {n} files, but poses {self.poses.shape} and "
                f"ground_truth {self.ground_truth.shape}; expected (n, 4, 4) and (n, 2)"
            )

    def __len__(self) -> int:
        return len(self.files)

    def scan(self, index: int, columns: Sequence[str] = ()) -> Scan:
        """Read scan ``index``, and count its missing returns (see `Scan`).

        ``columns`` are further values of each point, behind x, y and z. Raises BrokenScanError for
        a file that cannot be decoded, or without any point, and as `expect_columns`.
        """
        file = self.files[index]
        records = self.read(file)
        if columns:
            self.expect_columns(columns)
            values = [self._column(name, file, len(records)) for name in columns]
            records = np.column_stack([records, *values])
        return scan_from(records, file)

    def points(self, index: int, columns: Sequence[str] = ()) -> Points:
        """Read scan ``index``: (m, 3) float32 in its own frame, without missing returns.

        With k ``columns`` it is (m, 3 + k). Raises as `scan` does.
        """
        return self.scan(index, columns).points

    def expect_columns(self, columns: Sequence[str]) -> None:
        """Raise DataError unless the scans have these columns."""
        for name in columns:
            if name not in self.columns:
                where = ""
                if name == "label" and self.files:
                    where = f" in {label_path(self.files[0]).parent}"
                many = name[:-1] + "ies" if name.endswith("y") else f"{name}s"
                raise DataError(
                    f"session {self.name}: its points have no {many}{where}, expected a dataset "
                    "whose points have them, or a method that needs none (docs: Downloads of "
                    "datasets)"
                )

    def _column(self, name: str, file: Path, count: int) -> NDArray[np.float32]:
        column = self.columns[name]
        values = column.read(file)
        if len(values) != count:
            source = file if column.file is None else column.file(file)
            raise BrokenScanError(
                f"{source}: {len(values)} {name}s for the {count} points of {file.name}; expected "
                "one for each"
            )
        return values.astype(np.float32)

    def __iter__(self) -> Iterator[Points]:
        """Stream the scans in driving order, one in memory at a time."""
        return (self.points(i) for i in range(len(self)))

    @property
    def positions(self) -> NDArray[np.float64]:
        """Planar world positions (n, 2), float64 metres, between which distances are measured."""
        return self.poses[:, :2, 3]
