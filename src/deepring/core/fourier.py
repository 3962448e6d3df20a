"""The Fourier transforms of Eq. 7 and 8, also for empty batches, which torch rejects on a CPU."""

from collections.abc import Callable
from typing import Any

import torch
from jaxtyping import Shaped
from torch import Tensor


def _of_any_batch(name: str) -> Callable[..., Tensor]:
    """The function ``name`` of torch.fft, also for batch axes of length 0."""

    def transform(values: Shaped[Tensor, "..."], **arguments: Any) -> Shaped[Tensor, "..."]:
        function = getattr(torch.fft, name)
        if values.numel():
            return function(values, **arguments)
        one = values.new_zeros([max(1, length) for length in values.shape])
        batch = tuple(slice(None) if length else slice(0) for length in values.shape)
        return function(one, **arguments)[batch]

    return transform


rfft, irfft = _of_any_batch("rfft"), _of_any_batch("irfft")
fft, fft2 = _of_any_batch("fft"), _of_any_batch("fft2")
rfft2, irfft2 = _of_any_batch("rfft2"), _of_any_batch("irfft2")
