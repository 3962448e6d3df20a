"""What tensors a file has: names, types, and shapes that agree with each other."""

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
"""A number, the name of a number that is the same throughout a file, or ``...`` for any others."""


@dataclass(frozen=True)
class TensorType:
    """A tensor's type and shape."""

    dtype: str | tuple[str, ...]
    """As torch names it, such as 'float32', or several that are allowed."""
    shape: tuple[Size, ...]
    """Such as ``("n", 4, 4)``. ``...`` may come last."""
    optional: bool = False

    @property
    def dtypes(self) -> tuple[str, ...]:
        """All dtypes that are allowed."""
        return (self.dtype,) if isinstance(self.dtype, str) else self.dtype

    def __str__(self) -> str:
        sizes = ", ".join("..." if size is ... else str(size) for size in self.shape)
        return f"{' or '.join(self.dtypes)} of shape ({sizes})"


#: Tensors by name. A name that ends with ".*" stands for any number of tensors of that beginning,
#: of any types and shapes; "*" for all that have no type of their own.
TensorTypes = Mapping[str, TensorType | None]


def check_tensors(tensors: Mapping[str, "Array"], types: TensorTypes) -> dict[str, int]:
    """The sizes that the types name. Raises DataError where tensors and types disagree.

    Names are compared first: one error lists all that are missing or unknown. Arrays of numpy
    will do as well.
    """
    groups = tuple(name.removesuffix("*") for name in types if name.endswith("*"))
    named = {name: kind for name, kind in types.items() if kind is not None}
    alone = {name: value for name, value in tensors.items() if not _in_group(name, groups, named)}
    optional = {name for name, kind in named.items() if kind.optional}
    missing, unknown = sorted(set(named) - optional - set(alone)), sorted(set(alone) - set(named))
    problems = [f"lacks {', '.join(missing)}"] if missing else []
    problems += [f"has an unknown {', '.join(unknown)}"] if unknown else []
    if problems:
        expected = ", ".join(types)
        raise DataError(f"tensors: {' and '.join(problems)}; expected {expected}")
    sizes: dict[str, int] = {}
    for name, kind in named.items():
        tensor = alone.get(name)
        if tensor is not None and not _fits(tensor, kind, sizes):
            told = {k: v for k, v in sizes.items() if k in kind.shape}
            where = "".join(f", {size} = {value}" for size, value in told.items())
            raise DataError(
                f"tensor {name}: {dtype_of(tensor)} of shape {tuple(tensor.shape)}, expected "
                f"{kind}{where}"
            )
    return sizes


def dtype_of(tensor: "Array") -> str:
    """Such as 'float32'."""
    return str(tensor.dtype).removeprefix("torch.")


def _in_group(name: str, groups: tuple[str, ...], named: Mapping[str, TensorType]) -> bool:
    return name not in named and name.startswith(groups)


def _fits(tensor: "Array", kind: TensorType, sizes: dict[str, int]) -> bool:
    """Whether dtype and shape fit; sizes that are new are remembered."""
    shape, wanted = tuple(tensor.shape), kind.shape
    if wanted and wanted[-1] is ...:
        shape, wanted = shape[: len(wanted) - 1], wanted[:-1]
    if dtype_of(tensor) not in kind.dtypes or len(shape) != len(wanted):
        return False
    for size, expected in zip(shape, wanted, strict=True):
        known = sizes.setdefault(expected, size) if isinstance(expected, str) else expected
        if size != known:
            return False
    return True
