"""What a known motion of a scan leaves of a method's score.

A twin that scores as the scan itself lost nothing, one that scores as another place all.
The twin consists of the same points, moved: nothing is hidden or uncovered, as it would be on a
real second visit.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.core.rigid import turn_points
from deepring.data.session import Points
from deepring.errors import DataError
from deepring.methods.method import Method
from deepring.rasters import Raster

Position = NDArray[np.float64]
"""Planar, (2,), metres."""

#: Two views of 70 m: scans farther apart than this show nothing of each other.
UNRELATED_M = 140.0


class Motion(NamedTuple):
    """A turn (degrees, counter-clockwise), then a shift (x, y) in metres."""

    yaw_deg: float
    shift: tuple[float, float] = (0.0, 0.0)

    def __call__(self, points: Points) -> Points:
        """The points (n, 3 + k) moved; what they have beside their coordinates stays."""
        moved = points.copy()
        moved[:, :3] = turn_points(points[:, :3], math.radians(self.yaw_deg))
        moved[:, :2] += np.asarray(self.shift, dtype=moved.dtype)
        return moved


class SectorTurn(NamedTuple):
    """A turn of the raster itself by whole steps of its azimuth, counter-clockwise: no rounding."""

    steps: int

    def __call__(self, raster: Raster, image: Tensor) -> Tensor:
        """The image (*raster.shape) turned."""
        return raster.turned(image[None], torch.tensor([self.steps]))[0]


class Place(NamedTuple):
    """Where a scan was taken."""

    number: int
    """Of its file."""
    position: Position | None
    """None where it is not known: another file is then another place."""


class Scan(NamedTuple):
    """A scan that is moved."""

    points: Points
    """(n, 3 + k) metres, in the scan's frame."""
    place: Place


@dataclass(frozen=True, eq=False)
class MovedScores:
    """Scores of scans with themselves, with their moved twins, and with scans of other places."""

    own: NDArray[np.float64]  # (n,)
    twins: NDArray[np.float64]  # (n, motions)
    turns: NDArray[np.float64] | None  # (n, motions), radians as compare tells; None if it does not
    others: NDArray[np.float64]  # (k,)
    changes: NDArray[np.float64]  # (n, motions), relative change of the descriptor
    descriptors: Tensor  # (n, ...) of the scans
    seconds: float  # from points to one descriptor, the quickest: others may have been held up

    @property
    def gap(self) -> float:
        """By how much scans score more with themselves than with others, on average.

        NaN where they do not, and where there is no other place.
        """
        gap = float(self.own.mean() - self.others.mean()) if len(self.others) else math.nan
        return gap if gap > 0 else math.nan

    @property
    def lost(self) -> NDArray[np.float64]:
        """(n, motions): 0 where a twin scores as the scan itself, 1 as unrelated scans do."""
        return (self.own[:, None] - self.twins) / self.gap


def moved_scores(
    method: Method,
    scans: Sequence[Scan],
    motions: Sequence[tuple[Motion, Sequence[Motion | SectorTurn]]],
    ground_z: float,
    columns: Sequence[str] = (),
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> MovedScores:
    """Describe each scan and its twins, and compare the twins with the scan.

    Args:
        method: of any kind.
        scans: at least one.
        motions: for each scan that of itself, and those of its twins, of as many for each; sectors
            are turned from the scan as it is moved itself.
        ground_z: z of the ground below the sensor in the scans' frame, metres.
        columns: the names of what the points have behind x, y and z.
        seed: which other place a scan is compared with.
        progress: called with (done, total) scans.

    Raises:
        DataError: no scan, or points without a column that the method needs.
    """
    if not scans:
        raise DataError("scans: none given; expected at least one")
    taken = [0, 1, 2, *(3 + k for k in column_indices(method, columns))]
    own, twins, turns, changes, stills, seconds = [], [], [], [], [], []
    for number, (scan, (first, others)) in enumerate(zip(scans, motions, strict=True)):
        points = np.ascontiguousarray(scan.points[:, taken])
        itself = first(points)
        begun = time.perf_counter()
        image = image_of(method, itself, ground_z)
        still = method.describe(image[None]).cpu()
        seconds.append(time.perf_counter() - begun)
        images = [
            motion(method.raster, image)
            if isinstance(motion, SectorTurn)
            else image_of(method, motion(points), ground_z)
            for motion in others
        ]
        moved = method.describe(torch.stack(images)).cpu()
        compared = method.compare(moved, still)
        own.append(float(method.compare(still, still).score))
        twins.append(compared.score[:, 0].tolist())
        turns.append(None if compared.turn is None else compared.turn[:, 0].tolist())
        difference = (moved - still).flatten(1).norm(dim=1) / still.norm().clamp_min(1e-30)
        changes.append(difference.tolist())
        stills.append(still)
        progress(number + 1, len(scans))
    pairs = other_places([scan.place for scan in scans], np.random.default_rng(seed))
    return MovedScores(
        np.array(own),
        np.array(twins),
        None if any(turn is None for turn in turns) else np.array(turns),
        np.array([float(method.compare(stills[a], stills[b]).score) for a, b in pairs]),
        np.array(changes),
        torch.cat(stills),
        min(seconds),
    )


def image_of(method: Method, points: Points, ground_z: float) -> Tensor:
    """The raster (*raster.shape) that the method has of a scan."""
    return torch.from_numpy(method.raster(points, ground_z))


def column_indices(method: Method, columns: Sequence[str]) -> list[int]:
    """Which of ``columns`` the method takes. Raises DataError for one that is not there."""
    needed = getattr(method.raster, "columns", ())
    missing = [name for name in needed if name not in columns]
    if missing:
        raise DataError(f"scans: their points have no {missing[0]}s, expected them")
    return [columns.index(name) for name in needed]


def other_places(places: Sequence[Place], rng: np.random.Generator) -> list[tuple[int, int]]:
    """Each place with a random other one, where there is one: indices of both."""
    pairs = []
    for a, place in enumerate(places):
        others = [b for b, other in enumerate(places) if _apart(place, other)]
        if others:
            pairs.append((a, others[int(rng.integers(len(others)))]))
    return pairs


def _apart(a: Place, b: Place) -> bool:
    if a.position is None or b.position is None:
        return a.number != b.number
    return float(np.linalg.norm(a.position - b.position)) > UNRELATED_M
