"""One query of a test as a page shows it: its scan, the place that was found, and the nearest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.reports.lie import Lie

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ScanView:
    """A scan as it is drawn."""

    number: int
    """Of the scan in its session."""
    image: NDArray[np.bool_]
    """(n, n) from above, indexed [x, y]."""
    sinogram: NDArray[np.float32] | None = None
    """(θ, τ) by the method, where it makes one."""
    descriptor: NDArray[np.float32] | None = None
    """(rows, columns), as the method compares it."""


@dataclass(frozen=True, eq=False)
class PlaceView:
    """A place beside a query."""

    scan: ScanView
    metres: float
    """From the query."""
    score: float | None
    true: Lie
    told: Lie | None = None
    """By the method, where it tells."""
    aligned: Lie | None = None
    """By the alignment of the two images."""
    fit: float = 0.0
    """Of the alignment, at most 1."""
    curve: NDArray[np.float32] | None = None
    """(θ,) the score over turns, over all of `QueryMap.period`; where the method turns."""


@dataclass(frozen=True, eq=False)
class QueryView:
    """A query with its pictures."""

    row: int
    """Of the query in the map."""
    scan: ScanView
    found: PlaceView
    nearest: PlaceView | None
    """None where the place that was found is the nearest."""


@dataclass(frozen=True, eq=False)
class QueryMap:
    """All queries of a test from above, and the pictures of some."""

    title: str
    method: str
    """The name of the method whose places are shown."""
    radius: float
    axes: tuple[str, str]
    """What grows to the right, and what upwards."""
    places: Floats
    """(p, 2) metres, right and up."""
    queries: Floats
    """(q, 2)"""
    numbers: NDArray[np.int64]
    """(q,) of the scans in their session."""
    found: NDArray[np.int64]
    """(q,) rows of the places that were found."""
    metres: NDArray[np.float32]
    """(q,) from the query to that place."""
    nearest: NDArray[np.float32]
    """(q,) from the query to the nearest place."""
    scores: NDArray[np.float32]
    by_method: Mapping[str, NDArray[np.float32]]
    """Name of a method to (q,) metres from the query to the place that it found, NaN where it was
    not asked; that of ``method`` among them."""
    views: Sequence[QueryView] = ()
    extent: float = 70.0
    """Half the side of the images, metres."""
    period: float = 360.0
    """Degrees that the rows of sinograms span."""

    @property
    def answerable(self) -> NDArray[np.bool_]:
        """Whether a place lies within the radius."""
        return self.nearest <= np.float32(self.radius)

    @property
    def right(self) -> NDArray[np.bool_]:
        """Whether the place that was found does."""
        return self.metres <= np.float32(self.radius)


def chosen(scores: NDArray[np.float32], wrong: NDArray[np.bool_], most: int) -> list[int]:
    """The rows of at most so many queries, in rising order.

    Half are wrong ones, those of the highest scores; the others are spread evenly over the rest.
    Where either are fewer, the others are more.
    """
    of_wrong = np.flatnonzero(wrong)
    of_wrong = of_wrong[np.argsort(-scores[of_wrong], kind="stable")]
    rest = np.flatnonzero(~wrong)
    worst = of_wrong[: max(most // 2, most - len(rest))]
    spread = np.linspace(0, len(rest) - 1, min(len(rest), most - len(worst))).round().astype(int)
    return sorted({*worst.tolist(), *rest[spread].tolist()})
