"""Describe many scans in batches."""

from typing import Protocol

import torch
from torch import Tensor

from deepring.methods.base import Method
from deepring.progress import Progress


class Images(Protocol):
    """A tensor, or `Rasters` that unpack what is asked for."""

    def __len__(self) -> int: ...
    def __getitem__(self, rows: slice, /) -> Tensor: ...


def describe_all(
    method: Method,
    images: Images,
    batch: int = 64,
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> Tensor:
    """Descriptors (n, ...) of n images, ``batch`` in memory at a time, made on ``device``."""
    parts = []
    for k in range(0, len(images), batch):
        parts.append(method.describe(images[k : k + batch].to(device)))
        if progress is not None:
            progress(min(k + batch, len(images)), len(images))
    return torch.cat(parts)
