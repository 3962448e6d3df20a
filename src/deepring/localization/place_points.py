"""Points of the places of a map, on which a scan is registered."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.errors import DataError
from deepring.localization.given import given_list
from deepring.localization.scan_points import scan_points
from deepring.rasters.downsample import voxel_means

#: Side of a voxel, metres; a place keeps one point per voxel, the mean of those in it.
VOXEL = 0.5

#: Steps of the coordinates, metres. With int16 they reach 327 m; points further away are dropped.
STEP = 0.01

#: Names of the tensors of a file.
XYZ, COUNTS = "points.xyz", "points.counts"


class PlacePoints:
    """Thinned points of places, each in its place's own frame, in the order of the places."""

    def __init__(self) -> None:
        self._places: list[NDArray[np.int16]] = []

    def __len__(self) -> int:
        return len(self._places)

    @property
    def count(self) -> int:
        """Points of all places."""
        return sum(len(points) for points in self._places)

    def add(self, thinned: Sequence[NDArray[np.int16]]) -> None:
        """Add places, of each what `thinned_points` gives."""
        self._places.extend(thinned)

    def of(self, place: int) -> NDArray[np.float32]:
        """Points (n, 3) of a place, metres in its own frame."""
        return self._places[place].astype(np.float32) * np.float32(STEP)

    def mark(self) -> int:
        """The present places, to which `rewind` goes back."""
        return len(self._places)

    def rewind(self, mark: int) -> None:
        """Drop the places added since `mark`."""
        del self._places[mark:]

    def tensors(self) -> dict[str, Tensor]:
        """Points (p, 3) int16 of all places, and how many each has, (n,) int32, for a file."""
        counts = torch.tensor([len(points) for points in self._places], dtype=torch.int32)
        every = np.concatenate([np.empty((0, 3), np.int16), *self._places])
        return {XYZ: torch.from_numpy(every), COUNTS: counts}

    @classmethod
    def restored(cls, tensors: Mapping[str, Tensor], places: int) -> "PlacePoints | None":
        """The points that a file has, without a copy; None if it has none.

        Raises DataError for one of the two tensors alone, and for counts that are not those of
        ``places`` places.
        """
        if XYZ not in tensors and COUNTS not in tensors:
            return None
        if XYZ not in tensors or COUNTS not in tensors:
            raise DataError(f"points: one tensor, expected {XYZ} and {COUNTS}")
        xyz, counts = tensors[XYZ].numpy(), tensors[COUNTS].numpy().astype(np.int64)
        if len(counts) != places or (counts < 0).any() or counts.sum() != len(xyz):
            raise DataError(
                f"points: counts of {len(counts)} places and {counts.sum()} points, expected "
                f"{places} and {len(xyz)}"
            )
        points = cls()
        points.add(np.split(xyz, np.cumsum(counts)[:-1]) if places else [])
        return points


def given_points(points: Any, count: int) -> list[NDArray[np.int16]]:
    """What a map keeps of the points of ``count`` scans that a caller gives, one for each place.

    Raises DataError for anything else.
    """
    if points is None:
        raise DataError("points: None, expected those of each scan: this map keeps them")
    scans = given_list("points", points, "scans (n, 3)")
    if len(scans) != count:
        raise DataError(f"points: {len(scans)} scans, expected {count}, one for each place")
    return [thinned_points(scan_points(f"points[{k}]", scan)) for k, scan in enumerate(scans)]


def thinned_points(points: NDArray[np.float32]) -> NDArray[np.int16]:
    """One point per `VOXEL` of the points (n, 3), metres: (m, 3) int16 in `STEP`.

    >>> thinned_points(np.array([[1, 2, 3], [1.25, 2, 3], [400, 0, 0]], dtype=np.float32))
    array([[112, 200, 300]], dtype=int16)
    """
    reach = np.iinfo(np.int16).max * STEP
    near = points[(np.abs(points) < reach).all(axis=1)]
    if not len(near):
        return np.empty((0, 3), np.int16)
    return np.rint(voxel_means(near, VOXEL) / STEP).astype(np.int16)
