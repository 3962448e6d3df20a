"""Specifications of the tensors of a file: names, dtypes, consistent shapes, ranges of values."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import EllipsisType
from typing import TYPE_CHECKING, Any

from deepring.errors import DataError

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    Array = Tensor | NDArray[Any]

Size = int | str | EllipsisType
"""A number, the name of a number that is equal throughout a file, or ``...`` for any others."""


@dataclass(frozen=True)
class TensorType:
    """A tensor's dtype and shape."""

    dtype: str | tuple[str, ...]
    """Torch's name of the dtype, e.g. 'float32', or several alternatives."""
    shape: tuple[Size, ...]
    """For example ``("n", 4, 4)``; the last one may be ``...``."""
    optional: bool = False
    least: float = -math.inf
    """Smallest value of any element, all of which are finite."""
    large: bool = False
    """Whether values are read only where every byte of a file is."""

    @property
    def dtypes(self) -> tuple[str, ...]:
        """The allowed dtypes."""
        return (self.dtype,) if isinstance(self.dtype, str) else self.dtype

    def __str__(self) -> str:
        sizes = ", ".join("..." if size is ... else str(size) for size in self.shape)
        return f"{' or '.join(self.dtypes)} of shape ({sizes})"


#: Tensors by name. A name that ends with ".*" stands for any number of tensors with that prefix and
#: any dtypes and shapes; "*" for all tensors without a type.
TensorTypes = Mapping[str, TensorType | None]


def check_tensors(tensors: Mapping[str, "Array"], types: TensorTypes) -> dict[str, int]:
    """The sizes named in the types. Raises DataError if tensors and types disagree.

    Names are compared first: one error lists all missing and unknown ones. NumPy arrays work too.
    """
    groups = tuple(name.removesuffix("*") for name in types if name.endswith("*"))
    kinds = {name: kind for name, kind in types.items() if kind is not None}
    single = {name: value for name, value in tensors.items() if not _in_group(name, groups, kinds)}
    optional = {name for name, kind in kinds.items() if kind.optional}
    missing = sorted(set(kinds) - optional - set(single))
    unknown = sorted(set(single) - set(kinds))
    problems = [f"lacks {', '.join(missing)}"] if missing else []
    problems += [f"has an unknown {', '.join(unknown)}"] if unknown else []
    if problems:
        raise DataError(f"tensors: {' and '.join(problems)}; expected {', '.join(types)}")
    sizes: dict[str, int] = {}
    for name, kind in kinds.items():
        tensor = single.get(name)
        if tensor is not None and not _fits(tensor, kind, sizes):
            where = "".join(f", {k} = {v}" for k, v in sizes.items() if k in kind.shape)
            raise DataError(
                f"tensor {name}: {dtype_of(tensor)} of shape {tuple(tensor.shape)}, expected "
                f"{kind}{where}"
            )
    return sizes


def check_values(
    tensors: "Mapping[str, Tensor]", types: TensorTypes, *, every: bool = False
) -> None:
    """Raise DataError for values that are not finite, or below the ``least`` of their type.

    Those of ``large`` tensors are read only with ``every``. Tensors without a type are read.
    """
    for name, tensor in tensors.items():
        kind = types.get(name)
        if kind is not None and kind.large and not every:
            continue
        if not tensor.is_floating_point() or not tensor.numel():
            continue
        least = -math.inf if kind is None else kind.least
        low, high = (float(value) for value in tensor.aminmax())  # NaN, if one is
        if not (math.isfinite(low) and math.isfinite(high)):
            raise DataError(f"tensor {name}: values that are not finite, expected finite numbers")
        if low < least:
            raise DataError(f"tensor {name}: a value of {low:g}, expected at least {least:g}")


def dtype_of(tensor: "Array") -> str:
    """Torch's name of the dtype, e.g. 'float32'."""
    return str(tensor.dtype).removeprefix("torch.")


def _in_group(name: str, groups: tuple[str, ...], kinds: Mapping[str, TensorType]) -> bool:
    return name not in kinds and name.startswith(groups)


def _fits(tensor: "Array", kind: TensorType, sizes: dict[str, int]) -> bool:
    """Whether dtype and shape match; adds new names to ``sizes``."""
    shape, pattern = tuple(tensor.shape), kind.shape
    if pattern and pattern[-1] is ...:
        shape, pattern = shape[: len(pattern) - 1], pattern[:-1]
    if dtype_of(tensor) not in kind.dtypes or len(shape) != len(pattern):
        return False
    for length, size in zip(shape, pattern, strict=True):
        if length != (sizes.setdefault(size, length) if isinstance(size, str) else size):
            return False
    return True
