"""Describe many scans in batches."""

from collections.abc import Iterator
from typing import Protocol

import torch
from jaxtyping import Float
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
) -> Float[Tensor, " n *descriptor"]:
    """Descriptors (n, ...) of n images, ``batch`` in memory at a time, made on ``device``."""
    return torch.cat(list(describe_batches(method, images, batch, device, progress)))


def describe_batches(
    method: Method,
    images: Images,
    batch: int = 64,
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> Iterator[Tensor]:
    """`describe_all` batch by batch, each made when it is asked for.

    ``progress`` is called when the next batch is asked for, so that it counts the work on the one
    before.
    """
    for k in range(0, len(images), batch):
        yield method.describe(images[k : k + batch].to(device))
        if progress is not None:
            progress(min(k + batch, len(images)), len(images))
