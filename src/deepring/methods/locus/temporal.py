"""Locus's pooling over time: what a segment looked like in the scans before.

A descriptor of a scan alone cannot have it: it takes the scans before and how the sensor moved.
`describe_drive` describes consecutive scans of one drive with their poses.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.errors import DataError
from deepring.methods.given import given_rasters
from deepring.methods.locus import Locus
from deepring.methods.locus.pooling import nearest_weights, pooled_neighbours

#: Scans described at once.
_SCANS = 16


@torch.no_grad()
def describe_drive(
    method: Locus,
    rasters: Any,
    poses: NDArray[np.float64],
    ground_z: float = 0.0,
    previous: int = 3,
) -> Float[Tensor, "t value"]:
    """Descriptors (t, feature²) of consecutive scans, pooled over space and time, as published.

    What stands for a segment's surroundings is the mean of its neighbours' features
    (`pooled_neighbours`) and of what it looked like before (`pooled_over_time`). The first scan
    has none before it.

    Args:
        method: trained or not.
        rasters: (t, *method.raster.shape) in driving order, none left out.
        poses: (t, 4, 4) world <- scan frame, metres, of any world.
        ground_z: z of the ground under the sensor in the scans' frame, metres.
        previous: scans before each that are pooled over; published are 3 at 10 Hz.

    Raises:
        DataError: rasters that are not the method's, or poses of another shape or not finite.
    """
    rasters = given_rasters(method.raster, rasters)
    checks.count("previous", previous, 0)
    poses = np.asarray(poses, dtype=np.float64)
    if poses.shape != (len(rasters), 4, 4) or not np.isfinite(poses).all():
        raise DataError(
            f"poses: shape {poses.shape}, expected ({len(rasters)}, 4, 4) finite numbers, one pose "
            "for each raster"
        )
    with _evaluating(method):
        lots = (rasters[k : k + _SCANS] for k in range(0, len(rasters), _SCANS))
        scans = [scan for lot in lots for scan in _described(method, lot)]
    above = np.eye(4)
    above[2, 3] = -ground_z  # centres have z above the ground
    frames = above @ np.linalg.inv(poses) @ np.roll(poses, -1, axis=0) @ np.linalg.inv(above)
    links = [
        _links_before(scans[k - 1], scans[k], frames[k - 1], method.settings.least_segments)
        if k
        else None
        for k in range(len(scans))
    ]
    vectors = [_descriptor(method, scans, links, k, previous) for k in range(len(scans))]
    return torch.cat(vectors) if vectors else rasters.new_zeros(0, *method.descriptor_shape).float()


def links_to(
    features: Float[Tensor, "n feature"],
    centres: Float64[np.ndarray, "n 3"],
    before: Float[Tensor, "m feature"],
    centres_before: Float64[np.ndarray, "m 3"],
    candidates: int = 5,
    radius: float = 2.0,
) -> Int64[np.ndarray, " n"]:
    """Which of m segments before is each of n segments, (n,); -1 for none.

    It has to be among the ``candidates`` with the nearest features, and its centre within
    ``radius`` metres. Of several the first counts, unless a later one is nearer in both.

    Args:
        features: (n, feature).
        centres: (n, 3) metres, in the frame of those before.
        before: (m, feature).
        centres_before: (m, 3) metres.
        candidates: how many.
        radius: metres.
    """
    links = np.full(len(features), -1, dtype=np.int64)
    if not len(before) or not len(features):
        return links
    alike = torch.cdist(features.double(), before.double()).cpu().numpy()
    apart = np.linalg.norm(centres[:, None] - centres_before[None], axis=2)
    order = np.argsort(alike, axis=1, kind="stable")[:, :candidates]
    among = np.zeros(alike.shape, dtype=np.bool_)
    np.put_along_axis(among, order, True, axis=1)
    among &= apart <= radius
    for k, row in enumerate(among):
        for m in np.flatnonzero(row):
            best = links[k]
            if best < 0 or (apart[k, m] < apart[k, best] and alike[k, m] < alike[k, best]):
                links[k] = m
    return links


def pooled_over_time(
    feature: Float[Tensor, " feature"], earlier: Sequence[Float[Tensor, " feature"]]
) -> Float[Tensor, " feature"]:
    """A segment's own feature plus those of what it was before, weighted by how near they are.

    Weights are the softmax of -0.1 d, d the distance between the features. Without any earlier one
    it is the feature.
    """
    if not earlier:
        return feature
    rows = torch.stack(list(earlier))
    weights = nearest_weights(torch.linalg.vector_norm(rows - feature, dim=1))
    return feature + weights @ rows


class _Scan(NamedTuple):
    """One scan, described."""

    features: Tensor
    """(n, feature) of its segments."""
    spatial: Tensor
    """(n, feature): what stands around each."""
    centres: NDArray[np.float64]
    """(n, 3) metres, z above the ground."""


@contextmanager
def _evaluating(method: Locus) -> Iterator[None]:
    """The method in evaluation mode within the block."""
    training = [module for module in method.modules() if module.training]
    method.eval()
    try:
        yield
    finally:
        for module in training:
            module.training = True


def _described(method: Locus, rasters: Tensor) -> list[_Scan]:
    device = next(method.parameters()).device
    segments = method.segments(rasters.to(device))
    features = method.features(segments)
    spatial = pooled_neighbours(features, segments.distances, method.settings.neighbours)
    return [
        _Scan(f[here], g[here], c[here].double().cpu().numpy())
        for f, g, c, here in zip(features, spatial, segments.centres, segments.present, strict=True)
    ]


def _links_before(
    before: _Scan, scan: _Scan, frame: NDArray[np.float64], least: int
) -> NDArray[np.int64]:
    """The links of a scan's segments to those of the scan before; none to one of too few."""
    if len(before.features) < least:
        return np.full(len(scan.features), -1, dtype=np.int64)
    there = scan.centres @ frame[:3, :3].T + frame[:3, 3]
    return links_to(scan.features, there, before.features, before.centres)


def _descriptor(
    method: Locus,
    scans: Sequence[_Scan],
    links: Sequence[NDArray[np.int64] | None],
    k: int,
    previous: int,
) -> Tensor:
    scan = scans[k]
    temporal = torch.zeros_like(scan.features)
    for s, feature in enumerate(scan.features):
        earlier, place = [], s
        for back in range(previous):
            here = links[k - back] if k - back > 0 else None
            if here is None or here[place] < 0:
                break  # the chain ends at the first scan that does not show it
            place = int(here[place])
            earlier.append(scans[k - back - 1].features[place])
        temporal[s] = pooled_over_time(feature, earlier)
    present = torch.ones(1, len(scan.features), dtype=torch.bool, device=temporal.device)
    both = (scan.spatial + temporal) / 2
    return method.descriptors(present, scan.features[None], both[None])
