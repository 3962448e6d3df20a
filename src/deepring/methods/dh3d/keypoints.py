"""From the points of two scans to the pose between them: keypoints, matches, consensus."""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from numpy.typing import NDArray
from torch import Tensor

from deepring.nn.rigid_fit import rigid_fit

#: Triples of matches that are tried.
ROUNDS = 2000

#: Seed of the triples: the same scans give the same pose.
_SEED = 0

#: How often the pose is fitted again to all matches that agree with it.
_FITS = 3


class Keypoints(NamedTuple):
    """Chosen points of a scan."""

    points: Float[Tensor, "n 3"]
    """Metres."""
    descriptors: Float[Tensor, "n d"]
    """Of unit norm."""


class Consensus(NamedTuple):
    """The transform that most matches agree on."""

    transform: Float64[Tensor, "4 4"]
    """Carries points onto their targets."""
    agreeing: int
    """Matches within reach."""


def strongest(
    points: Float[Tensor, "n 3"], scores: Float[Tensor, " n"], number: int, apart: float
) -> Int64[Tensor, " m"]:
    """Numbers of the points with the highest scores, none within ``apart`` metres of a better one.

    Of equal scores the first point is better. At most ``number``, best first.
    """
    from scipy.spatial import KDTree

    cloud = points.double().cpu().numpy()
    order = scores.argsort(descending=True, stable=True).tolist()
    tree, free, chosen = KDTree(cloud), np.ones(len(cloud), dtype=np.bool_), []
    for k in order:
        if not free[k]:
            continue
        chosen.append(k)
        if len(chosen) == number:
            break
        free[tree.query_ball_point(cloud[k], apart)] = False
        free[k] = False
    return torch.tensor(chosen, dtype=torch.int64, device=points.device)


def mutual_matches(
    first: Float[Tensor, "n d"], second: Float[Tensor, "m d"]
) -> Int64[Tensor, "match 2"]:
    """Pairs of numbers that are each other's nearest descriptor.

    >>> mutual_matches(torch.tensor([[0.0], [4.0], [5.0]]), torch.tensor([[5.1], [0.2]]))
    tensor([[0, 1],
            [2, 0]])
    """
    apart = torch.cdist(first, second)
    there, back = apart.argmin(dim=1), apart.argmin(dim=0)
    numbers = torch.arange(len(first), device=first.device)
    mutual = back[there] == numbers
    return torch.stack([numbers[mutual], there[mutual]], dim=1)


def consensus(
    points: Float[Tensor, "n 3"], targets: Float[Tensor, "n 3"], reach: float
) -> Consensus | None:
    """The transform of three matches that carries most points to within ``reach`` of their targets.

    It is fitted to all of these matches at the end. None where no three matches tell a transform,
    or none carries three to within ``reach``.
    Source: Fischler and Bolles (RANSAC, 1981); triples whose sides differ by more than twice the
    reach are left out before they are fitted.
    """
    points, targets = points.double().cpu(), targets.double().cpu()
    triples = _triples(points.numpy(), targets.numpy(), reach)
    if not len(triples):
        return None
    equal = torch.ones(triples.shape, dtype=torch.float64)
    transforms, told = rigid_fit(points[triples], targets[triples], equal)
    transforms = transforms[told]
    if not len(transforms):
        return None
    within = _off(transforms, points, targets) < reach
    best = int(within.sum(dim=1).argmax())
    transform, agrees = transforms[best], within[best]
    if agrees.sum() < 3:  # not even the three that it was fitted to
        return None
    for _ in range(_FITS):
        fitted, known = rigid_fit(
            points[None, agrees], targets[None, agrees], equal[:1, :1].expand(1, int(agrees.sum()))
        )
        again = _off(fitted, points, targets)[0] < reach
        if not bool(known[0]) or again.sum() < agrees.sum():
            break
        transform, agrees = fitted[0], again
    return Consensus(transform, int(agrees.sum()))


def _triples(
    points: NDArray[np.float64], targets: NDArray[np.float64], reach: float
) -> Int64[Tensor, "triple 3"]:
    """Random triples of matches whose sides are about as long in both scans."""
    if len(points) < 3:
        return torch.zeros(0, 3, dtype=torch.int64)
    rng = np.random.default_rng(_SEED)
    drawn = rng.integers(len(points), size=(ROUNDS, 3))
    distinct = (drawn != np.roll(drawn, 1, axis=1)).all(axis=1)
    sides = [
        np.linalg.norm(cloud[drawn] - cloud[np.roll(drawn, 1, axis=1)], axis=2)
        for cloud in (points, targets)
    ]
    alike = (np.abs(sides[0] - sides[1]) < 2 * reach).all(axis=1)
    long = sides[0].min(axis=1) > 2 * reach  # short sides tell no rotation
    return torch.from_numpy(drawn[distinct & alike & long])


def _off(
    transforms: Float64[Tensor, "k 4 4"],
    points: Float64[Tensor, "n 3"],
    targets: Float64[Tensor, "n 3"],
) -> Float64[Tensor, "k n"]:
    """How far each transform carries each point from its target, metres."""
    moved = points @ transforms[:, :3, :3].transpose(1, 2) + transforms[:, None, :3, 3]
    return (moved - targets).norm(dim=-1)
