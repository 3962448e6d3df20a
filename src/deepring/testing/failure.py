"""What a check raises, and the differences that it measures."""

import math

import torch
from torch import Tensor

#: Tolerance of scores relative to the largest: sums differ slightly with the batch size.
TOLERANCE = 1e-4


class MethodError(AssertionError):
    """Raised for a property that a method lacks; the message says by how much."""

    def __init__(self, property: str, message: str) -> None:
        super().__init__(f"{property}: {message}")
        self.property = property


def away(angle: Tensor, period: float) -> Tensor:
    """Distance of angles from the nearest multiple of a period, radians."""
    return (torch.remainder(angle + period / 2, period) - period / 2).abs()


def difference(first: Tensor, second: Tensor) -> float:
    """Largest difference relative to the largest number; infinite where the shapes differ."""
    if first.shape != second.shape:
        return math.inf
    return float((first - second).abs().max() / second.abs().max().clamp_min(1e-30))
