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

Doubt = Literal["fit", "ratio", "few cells", "no rival"]
"""Why a location is not trusted: it fits too little; elsewhere it fits nearly as well; or one
cannot tell, since the images show too little, or no candidate was there to compare with."""

#: The fit from which a location without a rival is trusted. Of 22 400 pairs of scans of unrelated
#: places none fits better than 0.259; of scans up to 10 m apart 86 % fit as well as this (campuses
#: and cities 140 to 143, `benchmarks/unrelated.py`).
FIT_WITHOUT_RIVAL = 0.32

#: Occupied cells that both images need. Fewer, in one heap, fit any other heap: of the same
#: unrelated pairs, but with 80 cells each, 22 % fit at 0.32 or better. The scans of those worlds
#: have 131 cells or more, real ones of seven sensors 173 or more.
FEW_CELLS = 100

#: The same without a rival: of unrelated pairs with 200 cells each, 0.2 % fit at 0.32 or better.
CELLS_WITHOUT_RIVAL = 200


@dataclass(frozen=True)
class AcceptanceThresholds:
    """Thresholds for trusting a location, which has to reach both.

    With the defaults, 99.8 % of the trusted locations are right on simulated worlds where half of
    the scans are nowhere in the map (`make weights`).

    A ratio is infinite where no candidate puts the scan elsewhere: nothing was compared, and a fit
    of at least `FIT_WITHOUT_RIVAL` and `CELLS_WITHOUT_RIVAL` are asked in place of the ratio. A
    ``ratio`` of 0 asks for no comparison. Whatever the thresholds, images of less than `FEW_CELLS`
    are not trusted.

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

    @property
    def fit_without_rival(self) -> float:
        """Fit from which a location without a rival is trusted."""
        return max(self.fit, FIT_WITHOUT_RIVAL) if self.ratio > 0 else self.fit

    def accept(self, fit: F, ratio: F, cells: F) -> bool | NDArray[np.bool_]:
        """Whether to trust a location; for arrays (n,), an array (n,). NaN is never trusted.

        Args:
            fit: fit of the alignment.
            ratio: ratio of the fit to that of the rival.
            cells: occupied cells of the scan or the place, whichever has fewer.
        """
        alone = np.isposinf(ratio)
        asked = np.where(alone, self.fit_without_rival, self.fit)
        least = np.where(alone & (self.ratio > 0), CELLS_WITHOUT_RIVAL, FEW_CELLS)
        return (fit >= asked) & (alone | (ratio >= self.ratio)) & (cells >= least)

    def doubt(self, fit: float, ratio: float, cells: float) -> Doubt | None:
        """Why not to trust a location; None where `accept` trusts it."""
        if self.accept(fit, ratio, cells):
            return None
        if not fit >= self.fit:
            return "fit"
        if not cells >= FEW_CELLS:
            return "few cells"
        return "no rival" if ratio == math.inf else "ratio"


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
    """Ratio of the fit to the best fit that puts the scan elsewhere; infinite without one."""
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
    ratio: float
    """Ratio of the fit to the best fit of a candidate that contradicts it; infinite without one."""


def best_fit(
    alignment: Alignment, poses: Tensor, settings: RerankSettings, cells: Tensor | None = None
) -> BestFit:
    """The position of the query by the candidate that fits best.

    Args:
        alignment: of the query with each of k candidates.
        poses: (k, 3) of the candidates: x, y and yaw in the world, metres and radians.
        settings: which positions contradict each other.
        cells: (k,) occupied cells of the candidates. Where all that contradict the best have less
            than `FEW_CELLS`, there is no rival: nearly blank places fit nothing.
    """
    positions = world_positions(alignment.position, poses)
    fit = alignment.score
    best = int(fit.argmax())
    away = torch.linalg.vector_norm(positions - positions[best], dim=-1) > settings.apart
    comparable = away if cells is None else away & (cells >= FEW_CELLS)
    rival = float(fit[away].max()) if bool(comparable.any()) else 0.0
    ratio = float(fit[best]) / rival if rival > 0 else math.inf
    return BestFit(best, positions[best], float(fit[best]), ratio)
