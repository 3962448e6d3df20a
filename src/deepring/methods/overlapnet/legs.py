"""OverlapNet's legs: convolutions that leave one row of a range image.

Source: Chen et al., RSS 2020 (PRBonn/OverlapNet).
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError

#: The published layers: rows and columns of the kernel, steps along both, and channels.
PUBLISHED: tuple[tuple[int, ...], ...] = (
    (5, 15, 2, 2, 16),
    (3, 15, 2, 1, 32),
    (3, 15, 2, 1, 64),
    (3, 12, 2, 1, 64),
    (2, 9, 2, 1, 128),
    *(((1, 9, 1, 1, 128),) * 3),
    (1, 7, 1, 1, 128),
    (1, 5, 1, 1, 128),
    (1, 3, 1, 1, 128),
)


class Layer(NamedTuple):
    """A convolution; lengths are of rows (elevation) and columns (azimuth)."""

    rows: int
    columns: int
    row_step: int
    column_step: int
    channels: int


def checked_layers(layers: Sequence[Sequence[int]]) -> list[Layer]:
    """The layers. Raises ConfigError for other numbers than five, each of 1 or more, of each."""
    found = []
    for k, numbers in enumerate(layers):
        name = f"overlapnet.layers[{k}]"
        if len(numbers) != 5:
            raise ConfigError(
                f"{name}: {list(numbers)}, expected five numbers: rows and columns of the kernel, "
                "steps along rows and columns, channels"
            )
        found.append(Layer(*(checks.count(name, number, most=8192) for number in numbers)))
    if not found:
        raise ConfigError("overlapnet.layers: none, expected at least one")
    return found


def sizes(
    layers: Sequence[Layer], columns: int, rows: int, circular: bool
) -> list[tuple[int, int]]:
    """Columns and rows after each layer. Raises ConfigError where a layer has no room.

    >>> sizes([Layer(5, 15, 2, 2, 16), Layer(3, 15, 2, 1, 32)], 900, 64, circular=False)
    [(443, 30), (429, 14)]
    """
    found = []
    for k, layer in enumerate(layers):
        before = columns, rows
        rows = (rows - layer.rows) // layer.row_step + 1
        if circular:
            fits = (
                columns % layer.column_step == 0 and layer.column_step <= layer.columns <= columns
            )
            columns = columns // layer.column_step if fits else 0
        else:
            columns = (columns - layer.columns) // layer.column_step + 1
        if columns < 1 or rows < 1:
            around = " and, as it is circular, a step that divides the columns" if circular else ""
            raise ConfigError(
                f"overlapnet.layers[{k}]: {list(layer)} on an image of {before[1]} rows and "
                f"{before[0]} columns, expected a kernel that fits{around}; choose others, or "
                "another raster"
            )
        found.append((columns, rows))
    return found


class Legs(nn.Module):
    """(b, channels, θ, rows) -> (b, columns, channels), by convolutions with ReLU.

    They are valid along elevation. Along azimuth they are valid too, as published, and the seam of
    the image is seen by none; or ``circular``: a roll of the image by the product of the steps
    rolls the result by one.
    """

    def __init__(self, channels: int, layers: Sequence[Layer], circular: bool) -> None:
        super().__init__()
        self.layers, self.circular = list(layers), circular
        widths = [channels, *(layer.channels for layer in layers)]
        convolutions = [
            nn.Conv2d(
                *(inputs, layer.channels),
                kernel_size=(layer.columns, layer.rows),
                stride=(layer.column_step, layer.row_step),
            )
            for inputs, layer in zip(widths, layers, strict=False)
        ]
        for convolution in convolutions:
            nn.init.xavier_uniform_(convolution.weight)
            if convolution.bias is not None:
                nn.init.zeros_(convolution.bias)
        self.convolutions = nn.ModuleList(convolutions)

    def forward(
        self, x: Float[Tensor, "batch channel theta row"]
    ) -> Float[Tensor, "batch column out"]:
        """Feature columns."""
        for layer, convolution in zip(self.layers, self.convolutions, strict=True):
            if self.circular:
                around = layer.columns - layer.column_step
                x = F.pad(x, (0, 0, around // 2, around - around // 2), mode="circular")
            x = convolution(x).relu()
        return x.squeeze(-1).transpose(1, 2)
