"""The training scans of all datasets, with their positions and headings."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import planar_pose
from deepring.data.packed_rasters import Rasters
from deepring.data.scan_set import ScanSet
from deepring.errors import ConfigError

Neighbours = list[NDArray[np.int64]]
"""For each scan, sorted numbers of nearby scans."""


@dataclass(frozen=True, eq=False)
class TrainingScans:
    """n scans of the training regions."""

    positions: NDArray[np.float64]
    """(n, 2) metres from the dataset's origin, which preserves the precision of UTM."""
    dataset: NDArray[np.int64]
    """(n,) number of each scan's dataset."""
    headings: NDArray[np.float64]
    """(n,) radians, counter-clockwise in the world."""
    rasters: Rasters
    session: NDArray[np.int64]
    """(n,) number of each scan's session, over all datasets; those of one are in driving order."""
    frames: NDArray[np.float64] | None = None
    """(n, 4, 4): dataset <- points of the rasters, from z on the ground under the sensor; None
    where it is not known."""

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 3) metres, see `set_apart`."""
        return set_apart(self.positions, self.dataset)

    def level_pose(self, first: int, second: int) -> NDArray[np.float64]:
        """The level transform (4, 4) that carries the second scan's points onto the first's."""
        poses = []
        for scan in (first, second):
            x, y = self.positions[scan]
            poses.append(planar_pose(x, y, self.headings[scan]))
        return np.asarray(np.linalg.inv(poses[0]) @ poses[1])

    @classmethod
    def from_session(
        cls, scans: ScanSet, rasters: Rasters, dataset: int, origin: NDArray[np.float64]
    ) -> Self:
        """Scans of one session and their rasters; ``origin`` (2,) metres is the dataset's."""
        numbers = np.full(len(scans), dataset, dtype=np.int64)
        session = np.zeros_like(numbers)
        frames = scans.frames
        frames[:, :2, 3] -= origin
        return cls(scans.positions - origin, numbers, scans.headings, rasters, session, frames)

    @classmethod
    def concatenate(cls, sessions: Sequence[Self]) -> Self:
        """The scans of several sets with the same raster; no session is in two of them."""
        before = np.cumsum([0] + [scans.session.max(initial=-1) + 1 for scans in sessions])
        return cls(
            np.concatenate([scans.positions for scans in sessions]),
            np.concatenate([scans.dataset for scans in sessions]),
            np.concatenate([scans.headings for scans in sessions]),
            Rasters(
                np.concatenate([scans.rasters.data for scans in sessions]),
                sessions[0].rasters.raster,
            ),
            np.concatenate([scans.session + k for scans, k in zip(sessions, before, strict=False)]),
            _joined([scans.frames for scans in sessions]),
        )


def _joined(frames: Sequence[NDArray[np.float64] | None]) -> NDArray[np.float64] | None:
    """The frames of several sets; None where those of one are not known."""
    known = [part for part in frames if part is not None]
    return np.concatenate(known) if len(known) == len(frames) else None


def set_apart(positions: NDArray[np.float64], dataset: NDArray[np.int64]) -> NDArray[np.float64]:
    """Points (n, 3), metres, with datasets 1000 km apart along a third axis."""
    return np.column_stack([positions, dataset * 1e6])


def within(points: NDArray[np.float64], radius: float) -> Neighbours:
    """Numbers of the points within ``radius`` metres of each of (n, 3) points, itself included."""
    from scipy.spatial import KDTree

    numbers = KDTree(points).query_ball_point(points, radius, return_sorted=True)
    return [np.array(near, dtype=np.int64) for near in numbers]


def check_radii(positive_radius: float, negative_radius: float) -> None:
    """Raise ConfigError unless 0 < positive_radius <= negative_radius."""
    if not 0 < positive_radius <= negative_radius:
        raise ConfigError(
            f"sampling.positive_radius: {positive_radius} m, sampling.negative_radius: "
            f"{negative_radius} m; expected 0 < positive_radius <= negative_radius"
        )
