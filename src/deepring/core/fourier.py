"""The Fourier transforms of Eq. 7 and 8, also for empty batches, which torch rejects on a CPU."""

from functools import partial
from typing import Any

import torch
from jaxtyping import Shaped
from torch import Tensor


def _of_any_batch(
    name: str, values: Shaped[Tensor, "..."], **arguments: Any
) -> Shaped[Tensor, "..."]:
    """torch.fft's function of that name; axes that it does not transform may be of length 0."""
    function = getattr(torch.fft, name)
    if values.numel():
        return function(values, **arguments)
    one = values.new_zeros([max(1, length) for length in values.shape])
    batch = tuple(slice(None) if length else slice(0) for length in values.shape)
    return function(one, **arguments)[batch]


rfft, irfft = partial(_of_any_batch, "rfft"), partial(_of_any_batch, "irfft")
fft, ifft = partial(_of_any_batch, "fft"), partial(_of_any_batch, "ifft")
fft2 = partial(_of_any_batch, "fft2")
rfft2, irfft2 = partial(_of_any_batch, "rfft2"), partial(_of_any_batch, "irfft2")
