"""How well a scan fits a place elsewhere than where it fits best.

Of a map of one place nothing else can be compared. But two unrelated scans fit nearly as well in
many positions, and in a tunnel or between two straight walls so do two scans of one place.
"""

import torch
from torch import Tensor

from deepring.localization.alignment.image_correlation import (
    correlations,
    half_whitened,
    occupied_cells,
    turned_images,
)
from deepring.localization.candidates import RerankSettings


def fit_elsewhere(
    image: Tensor, place: Tensor, turn: float, position: Tensor, settings: RerankSettings
) -> float:
    """The best fit of a query with one place that contradicts an alignment of the two.

    Contradicting are positions more than ``apart`` metres away with the same heading, and all
    positions with the opposite heading, as far as the alignment reaches.

    Args:
        image: (n, n) occupancy of the query.
        place: (n, n) occupancy of the place.
        turn: radians, the turn of the points from place to query by the alignment.
        position: (2,) metres, of the query's sensor in the place's frame by the alignment.
        settings: how the two are aligned, and which positions contradict each other.
    """
    alignment = settings.alignment
    cells = occupied_cells(image, alignment)
    spectra = half_whitened(place[None], alignment)
    query = half_whitened(turned_images(cells, torch.tensor([turn]), alignment), alignment)
    curves = correlations(spectra, query, torch.tensor([[0, 0, 0], [0, 0, 1]]), alignment)
    reach = alignment.shifts
    curves = curves.roll((reach, reach), dims=(-2, -1))
    same, opposite = curves[:, : 2 * reach + 1, : 2 * reach + 1]
    along = alignment.cell * torch.arange(-reach, reach + 1)
    away = torch.hypot(along[:, None] - position[0], along - position[1]) > settings.apart
    return max(_largest(same[away]), _largest(opposite.flatten()))


def _largest(fits: Tensor) -> float:
    """The largest of some fits, which may be none; never negative."""
    return float(fits.max().clamp_min(0.0)) if len(fits) else 0.0
