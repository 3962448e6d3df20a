"""Describe many scans in batches."""

from typing import Protocol

import torch
from torch import Tensor

from deepring.methods.base import Method


class Images(Protocol):
    """A tensor, or `Rasters` that unpack what is asked for."""

    def __len__(self) -> int: ...
    def __getitem__(self, rows: slice, /) -> Tensor: ...


def describe_all(method: Method, images: Images, batch: int = 64) -> Tensor:
    """Descriptors (n, ...) of n images, ``batch`` in memory at a time."""
    parts = [method.describe(images[k : k + batch]) for k in range(0, len(images), batch)]
    return torch.cat(parts)
