"""Descriptors on disk: made once, scored many times, on any machine.

One sealed file per side, which also states how its descriptors were made.
"""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from deepring import checks
from deepring.errors import ConfigError, DataError, FileError
from deepring.evaluation.case import Case
from deepring.evaluation.fingerprint import json_copy
from deepring.io.sealed import SealedFormat, open_sealed, write_sealed
from deepring.io.tensor_types import TensorType, check_tensors

SideName = Literal["database", "query"]

#: Ending of the files' names.
ENDING = ".safetensors"

#: Largest coordinate of a place, metres.
_FARTHEST = 1e12

_ARRAYS = {
    "descriptors": TensorType("float32", ("n", ...)),
    "positions": TensorType("float64", ("n", 2)),
    "indices": TensorType("int64", ("n",)),
    "turns": TensorType("float64", ("n",), optional=True),
    "before": TensorType("int64", ("n",), optional=True),
}


@dataclass(frozen=True)
class DescriptorHeader:
    """Origin of the descriptors of one side of a retrieval task."""

    case: Case
    """The method, and where it was tested."""
    side: SideName
    session: str
    made_by: dict[str, Any]
    """Fingerprint of the method, see `deepring.evaluation.fingerprint`, as JSON gives it back."""
    ground_z: float
    """z of the ground under the sensor in the scans' frame, metres."""
    seconds_per_scan: float
    """From points to descriptor, measured on the queries when these were exported."""


@dataclass(frozen=True, eq=False)
class DescriptorSet(DescriptorHeader):
    """The n descriptors of one side of a retrieval task, and their origin.

    Raises ConfigError for a header that a file or a row of results cannot hold, and DataError for
    an empty set, arrays of another type or of counts that disagree, and values that are not
    finite.
    """

    descriptors: NDArray[np.float32]
    """(n, ...), as the method's ``describe`` gives them."""
    positions: NDArray[np.float64]
    """(n, 2) world positions, metres."""
    indices: NDArray[np.int64]
    """(n,) numbers of the scans in their session."""
    turns: NDArray[np.float64] | None = None
    """(n,) radians by which the scans were turned; None for scans that were not."""
    before: NDArray[np.int64] | None = None
    """(n,) of queries that are online: the first scan of the session that is too recent to be a
    place, see `deepring.data.dataset.RetrievalSet`."""

    def __post_init__(self) -> None:
        checks.one_of("side", self.side, SideName)
        if not (isinstance(self.session, str) and self.session.isprintable()):
            raise ConfigError(
                f"session: {self.session!r}, expected text without control characters"
            )
        checks.number("ground_z", self.ground_z, "metres")
        checks.at_least("seconds_per_scan", self.seconds_per_scan, 0, "seconds")
        task = f"{self.case.test}, region {self.case.region}"
        where = f"{task}, {self.side}"
        try:
            check_tensors(self.arrays, _ARRAYS)
        except DataError as error:
            raise DataError(
                f"{where}: {error}; convert them, in the method's describe() where it makes them"
            ) from None
        if not len(self):
            scans = "places" if self.side == "database" else "scans"
            raise DataError(f"{task}: the {self.side} holds 0 {scans}; expected at least one")
        for name, array in self.arrays.items():
            bad = int((~np.isfinite(array)).sum())
            if bad:
                raise DataError(
                    f"{where}: {name}: {bad} of {array.size} values are not finite; expected "
                    "numbers; look for empty scans, or for a training that diverged"
                )
        farthest = float(np.abs(self.positions).max())
        if farthest > _FARTHEST:
            raise DataError(
                f"{where}: positions: {farthest:.3g} metres from the origin of the world; expected "
                f"at most {_FARTHEST:.0e}; look at the poses"
            )
        object.__setattr__(self, "made_by", json_copy(self.made_by))

    def __len__(self) -> int:
        return len(self.descriptors)

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, without those that are None."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        return {name: array for name, array in arrays.items() if array is not None}


FORMAT = SealedFormat(
    "descriptors",
    2,
    DescriptorHeader,
    _ARRAYS,
    description="descriptors as evaluate_method(..., export=FOLDER) writes them",
    remedy="export them again",
)


def file_name(case: Case, side: SideName) -> str:
    """Name of a side's file: 'Scan_Context_20x60__sim_nclt__test__query.safetensors'."""
    return case.file_name(f"__{side}{ENDING}")


def free_path(folder: Path, case: Case, side: SideName) -> Path:
    """Path of a side's file in a folder; a file of the same case is replaced.

    Raises FileError if the file exists and holds something else.
    """
    path = folder / file_name(case, side)
    if not path.exists():
        return path
    try:
        present = read_descriptors(path).case
    except FileError as error:
        raise FileError(f"{error}; or delete it: descriptors are written to this path") from None
    if present != case:
        raise FileError(
            f"{path}: holds the descriptors of {present}, expected those of {case}; "
            "give the methods labels that differ in letters or digits, or delete the file"
        )
    return path


def write_descriptors(path: str | Path, descriptors: DescriptorSet) -> None:
    """Write a descriptor file in one step, creating folders as needed.

    Raises FileError where the file cannot be written.
    """
    header = DescriptorHeader(**{f.name: getattr(descriptors, f.name) for f in _HEADER_FIELDS})
    writable = {name: np.require(a, None, ["C", "W"]) for name, a in descriptors.arrays.items()}
    write_sealed(path, FORMAT, header, {k: torch.from_numpy(a) for k, a in writable.items()})


def read_descriptors(path: str | Path) -> DescriptorSet:
    """Read what `write_descriptors` wrote, every byte verified.

    Raises FileError for anything else, and for contents that `DescriptorSet` refuses.
    """
    file = open_sealed(path, FORMAT, check=True)
    arrays: dict[str, Any] = {name: tensor.numpy().copy() for name, tensor in file.tensors.items()}
    with file.contents():
        return DescriptorSet(**vars(file.header), **arrays)


_HEADER_FIELDS = fields(DescriptorHeader)
