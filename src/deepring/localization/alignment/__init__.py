"""The pose of one scan in another's frame, from their bird's-eye images.

The query is turned by each of a few turns, and a correlation over translations tells where it fits
best. Spectra are half whitened: divided by the root of their size, which sharpens the peak that
occupancy alone leaves broad. The height of the peak says how well the two fit.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from deepring.localization.alignment.image_correlation import (
    best_fits,
    half_whitened,
    smaller_images,
    vertex,
)
from deepring.localization.alignment.settings import AlignmentSettings


class Alignment(NamedTuple):
    """Pose of a query in the frames of n map scans."""

    score: Tensor
    """(n,) height of the correlation's peak, at most 1."""
    turn: Tensor
    """(n,) radians in [-π, π), the turn of the points from map scan to query."""
    position: Tensor
    """(n, 2) metres, of the query's sensor in the map scan's frame."""


def align(cells: Tensor, spectra: Tensor, turns: Tensor, settings: AlignmentSettings) -> Alignment:
    """Align one query with n map scans.

    Args:
        cells: (m, 2) occupied cells of the query, metres, see `occupied_cells`.
        spectra: (n, ...) of the map scans, see `half_whitened`.
        turns: (n, y) radians, turns of the points from map scan to query that are tried, each
            also one ``step`` smaller and larger. A descriptor that cannot tell a turn from its
            opposite gives both.
        settings: images and transforms.
    """
    heights, _ = _tried(cells, spectra, turns, settings)
    which = heights.amax(dim=-1).argmax(dim=-1)  # (n,)
    rows = torch.arange(len(turns), device=turns.device)
    turn = turns[rows, which] + settings.step * vertex(*heights[rows, which].unbind(dim=-1))
    score, shift = best_fits(cells, spectra, turn, settings)
    return Alignment(score, _wrapped(turn), shift * settings.cell)


def align_coarsely(
    cells: Tensor, images: Tensor, turns: Tensor, settings: AlignmentSettings
) -> Alignment:
    """`align` at half the resolution, which tells what is worth the full one.

    Scores are others than those of `align`, since unrelated scans fit better in larger cells. The
    turn is the one of ``turns`` that fits best.

    Args:
        cells: as of `align`.
        images: (n, cells, cells) of the map scans, 0 or 1.
        turns: as of `align`.
        settings: of the full resolution.
    """
    coarse = settings.coarse
    spectra = half_whitened(smaller_images(images, settings), coarse)
    heights, shifts = (v.flatten(1, 2) for v in _tried(cells, spectra, turns, coarse))
    score, trial = heights.max(dim=1)
    rows = torch.arange(len(turns), device=turns.device)
    turn = turns[rows, trial // 3]
    return Alignment(score, _wrapped(turn), shifts[rows, trial] * coarse.cell)


def world_positions(position: Tensor, poses: Tensor) -> Tensor:
    """Positions (k, 2) in the frames of planar poses (k, 3) as positions in the world (k, 2)."""
    cosine, sine = torch.cos(poses[:, 2]), torch.sin(poses[:, 2])
    x = poses[:, 0] + cosine * position[:, 0] - sine * position[:, 1]
    y = poses[:, 1] + sine * position[:, 0] + cosine * position[:, 1]
    return torch.stack([x, y], dim=-1)


def _tried(
    cells: Tensor, spectra: Tensor, turns: Tensor, settings: AlignmentSettings
) -> tuple[Tensor, Tensor]:
    """Heights (n, y, 3) and shifts (n, y, 3, 2) of the peaks at turns (n, y), each also one step
    smaller and larger."""
    offsets = settings.step * torch.tensor([-1.0, 0.0, 1.0], device=turns.device)
    return best_fits(cells, spectra, turns[..., None] + offsets, settings)


def _wrapped(turn: Tensor) -> Tensor:
    return torch.remainder(turn + math.pi, 2 * math.pi) - math.pi
