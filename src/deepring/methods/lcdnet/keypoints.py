"""Features of keypoints: what a network sees from above, and in balls around them at each level.

Source: voxel set abstraction of PV-RCNN (Shi et al., CVPR 2020, Sec. 3.2), as LCDNet uses it.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from deepring.nn.balls import rows_in_balls
from deepring.nn.sparse import SparseTensor


class BallFeatures(nn.Module):
    """The largest features of a perceptron over the points in two balls around each centre.

    The perceptron sees where a point lies from the centre, and its features; zeros where a ball
    is empty.
    """

    def __init__(
        self,
        channels: int,
        width: int,
        radii: Sequence[float],
        samples: Sequence[int],
        momentum: float,
    ) -> None:
        super().__init__()
        self.radii, self.samples = tuple(radii), tuple(samples)

        def perceptron() -> nn.Sequential:
            layers: list[nn.Module] = []
            for inputs in (3 + channels, width):
                linear = nn.Linear(inputs, width, bias=False)
                layers += [linear, nn.BatchNorm1d(width, momentum=momentum), nn.ReLU()]
            return nn.Sequential(*layers)

        self.perceptrons = nn.ModuleList(perceptron() for _ in radii)

    def forward(
        self,
        centres: Float[Tensor, "batch m 3"],
        points: Float[Tensor, "n 3"],
        features: Float[Tensor, "n channel"],
        counts: Sequence[int],
    ) -> Float[Tensor, "batch m out"]:
        """(b, m, width for each ball) of points (n, 3), ``counts`` of each of b clouds."""
        balls = []
        for radius, number, perceptron in zip(
            self.radii, self.samples, self.perceptrons, strict=True
        ):
            rows = rows_in_balls(centres, points, counts, radius, number)
            taken = rows.clamp_min(0).flatten()
            offsets = points.index_select(0, taken).view(*rows.shape, 3) - centres[:, :, None]
            seen = features.index_select(0, taken).view(*rows.shape, -1)
            inputs = torch.cat([offsets, seen], dim=-1) * (rows >= 0)[..., None]
            outputs = perceptron(inputs.flatten(0, 2)).view(*rows.shape, -1)
            balls.append(outputs.amax(dim=2))
        return torch.cat(balls, dim=-1)


def from_above(
    x: SparseTensor,
    layers: int,
    places: Float[Tensor, "batch m 2"],
) -> Float[Tensor, "batch m out"]:
    """Features at places between the sites of a plane, by bilinear interpolation.

    Args:
        x: features (n, c) on sites (batch, x, y, layer); 0 elsewhere.
        layers: sites along the last axis, whose features stand one after the other.
        places: (b, m, 2) x and y in sites: site (i, j) is at (i, j).

    Returns:
        (b, m, layers * c).
    """
    low = places.floor()
    share = places - low
    batch = torch.arange(len(places), device=places.device)[:, None, None, None]
    layer = torch.arange(layers, device=places.device)
    total: Tensor | float = 0.0
    for i in (0, 1):
        for j in (0, 1):
            weight = (share[..., 0] if i else 1 - share[..., 0]) * (
                share[..., 1] if j else 1 - share[..., 1]
            )
            corner = (low + low.new_tensor([i, j])).long()[:, :, None]
            size = (*places.shape[:2], layers, 1)
            sites = torch.cat(
                [
                    batch.expand(size),
                    corner.expand(*size[:3], 2),
                    layer[None, None, :, None].expand(size),
                ],
                dim=-1,
            )
            rows = x.grid.rows(sites.flatten(0, 2))
            found = x.features.index_select(0, rows.clamp_min(0)) * (rows >= 0)[:, None]
            total = total + weight[..., None] * found.view(*places.shape[:2], -1)
    assert isinstance(total, Tensor)
    return total
