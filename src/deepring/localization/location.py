"""Position of a query in the world, from candidates whose poses are known, and when to trust it.

The alignment with the candidate that fits best gives the query's position in that candidate's
frame, and the candidate's pose gives the position in the world. This is localisation with the map's
poses, not the paper's protocol: report it beside the protocol's results, never in their place.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.errors import ConfigError
from deepring.localization.alignment import Alignment, world_positions
from deepring.localization.candidates import RerankSettings

F = TypeVar("F", float, NDArray[np.float64])

Doubt = Literal["fit", "ratio", "few cells"]
"""Why a location is not trusted: it fits too little; elsewhere it fits nearly as well; or the
images show too little to tell such a fit from chance."""

#: Two images fit each other by chance the better the fewer cells they have: in proportion to one
#: over the root. The fit that is asked is at least this over the root of the cells. Chosen on
#: worlds 200 to 203, see docs/localization_figures.md: with 3.5 more scans from nowhere are trusted
#: (5 of 11 381 in place of 2), with 4.5 none, but 1 in 100 less of those that are in the map.
FIT_TIMES_ROOT_OF_CELLS = 4.0

#: Occupied cells that both images need. Fewer, in one heap, fit any other heap: of unrelated pairs
#: with 80 cells each 1 % fit at 0.47 or better (`benchmarks/unrelated.py --cells 80`). The scans
#: of simulated worlds have 131 cells or more, real ones of seven sensors 173 or more.
FEW_CELLS = 100


@dataclass(frozen=True)
class AcceptanceThresholds:
    """Thresholds for trusting a location, which has to reach both.

    Whatever the thresholds, the fit has to be at least `FIT_TIMES_ROOT_OF_CELLS` over the root of
    the cells, and images of less than `FEW_CELLS` are not trusted. How many places there are to
    compare with does not count: a location has a rival in the same place too.

    Raises ConfigError for thresholds that are not numbers.
    """

    fit: float = 0.21
    """Fit of the alignment, at most 1."""
    ratio: float = 1.41
    """Ratio of the fit to the best fit that puts the scan elsewhere."""

    def __post_init__(self) -> None:
        for name in ("fit", "ratio"):
            value = getattr(self, name)
            if not isinstance(value, int | float) or isinstance(value, bool) or math.isnan(value):
                raise ConfigError(f"thresholds.{name}: {value!r}, expected a number")

    def fit_asked(self, cells: F) -> NDArray[np.float64]:
        """The fit from which images of so many occupied cells are trusted; an array for one."""
        return np.maximum(self.fit, FIT_TIMES_ROOT_OF_CELLS / np.sqrt(np.maximum(cells, 1.0)))

    def accept(self, fit: F, ratio: F, cells: F) -> bool | NDArray[np.bool_]:
        """Whether to trust a location; for arrays (n,), an array (n,). NaN is never trusted.

        Args:
            fit: fit of the alignment.
            ratio: ratio of the fit to that of the rival.
            cells: occupied cells of the scan or the place, whichever has fewer.
        """
        return (fit >= self.fit_asked(cells)) & (ratio >= self.ratio) & (cells >= FEW_CELLS)

    def doubt(self, fit: float, ratio: float, cells: float) -> Doubt | None:
        """Why not to trust a location; None where `accept` trusts it."""
        if self.accept(fit, ratio, cells):
            return None
        if not fit >= self.fit:
            return "fit"
        return "few cells" if ratio >= self.ratio else "ratio"


@dataclass(frozen=True)
class Location:
    """Position and heading of a scan in the world."""

    place: int
    """Index of the map place that the scan was aligned with."""
    name: str
    """Name of that place's scan."""
    x: float
    """Metres, in the world of the map's poses."""
    y: float
    yaw: float
    """Heading in the world, radians in [-π, π)."""
    similarity: float
    """Similarity of the descriptors; higher is more alike."""
    fit: float
    """Fit of the alignment, at most 1."""
    ratio: float
    """Ratio of the fit to the best fit that puts the scan elsewhere, in another place or this."""
    cells: int
    """Occupied cells of the scan's image or of the place's, whichever has fewer."""
    trusted: bool
    doubt: Doubt | None
    """Why it is not trusted; None if it is."""


class BestFit(NamedTuple):
    """The candidate that fits best, and the position of the query by it."""

    candidate: int
    position: Tensor
    """(2,) metres in the world of the map's poses."""
    fit: float
    """Height of the correlation's peak, at most 1."""
    rival: float
    """The best fit of a candidate that contradicts it; 0 without one."""

    @property
    def ratio(self) -> float:
        """Ratio of the fit to that of the rival; infinite without one."""
        return ratio_of(self.fit, self.rival)


def ratio_of(fit: float, rival: float) -> float:
    """Ratio of a fit to that of a rival; infinite to none, which fits by 0."""
    return fit / rival if rival > 0 else math.inf


def best_fit(alignment: Alignment, poses: Tensor, settings: RerankSettings) -> BestFit:
    """The position of the query by the candidate that fits best.

    Args:
        alignment: of the query with each of k candidates.
        poses: (k, 3) of the candidates: x, y and yaw in the world, metres and radians.
        settings: which positions contradict each other.
    """
    positions = world_positions(alignment.position, poses)
    fit = alignment.score
    best = int(fit.argmax())
    away = torch.linalg.vector_norm(positions - positions[best], dim=-1) > settings.apart
    rival = max(0.0, float(fit[away].max())) if bool(away.any()) else 0.0
    return BestFit(best, positions[best], float(fit[best]), rival)
