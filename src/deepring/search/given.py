"""Descriptors that callers give: tensors of one shape and of finite numbers, or none at all."""

import math
from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float, Shaped
from torch import Tensor

from deepring.core.arrays import expect_finite, real_tensor
from deepring.errors import DataError


def given_descriptors(
    name: str,
    values: Any,
    shape: Sequence[int] | None = None,
    axes: Sequence[str] = ("...",),
    others: str = "the places",
) -> Float[Tensor, " n *descriptor"]:
    """Descriptors (n, ...) of anything like an array of real numbers.

    Args:
        name: of the values, for messages.
        values: a floating tensor stays as it is, on its device; other numbers become float32.
        shape: of one descriptor; None takes any.
        axes: the names of a descriptor's axes; '...' takes one or more.
        others: what has that shape, for messages.

    Raises DataError for anything else, another shape, and numbers that are not finite in float32.
    In training, where gradients are wanted, the numbers are not looked at.
    """
    tensor = real_tensor(name, values)
    right = tensor.ndim >= 2 if "..." in axes else tensor.ndim == 1 + len(axes)
    if not right or tensor.dtype is torch.bool:
        raise DataError(
            f"{name}: {tensor.dtype}, shape {tuple(tensor.shape)}, expected descriptors "
            f"(n, {', '.join(axes)}) of floats, as `describe` gives them"
        )
    rows = given_rows(name, tensor, shape, others)
    return rows if rows.is_floating_point() else rows.float()


def given_rows(
    name: str, values: Any, shape: Sequence[int] | None = None, others: str = "the places"
) -> Shaped[Tensor, " n *descriptor"]:
    """`given_descriptors` of any type and of any number of axes, as a method of one's own has."""
    tensor = real_tensor(name, values)
    if not tensor.ndim:
        raise DataError(f"{name}: a single number, expected one descriptor or more (n, ...)")
    if shape is not None and tuple(tensor.shape[1:]) != tuple(shape):
        raise DataError(
            f"{name}: {_by(tensor.shape[1:])}, but {others} are {_by(shape)}; describe both by one "
            "method"
        )
    return tensor if tensor.requires_grad else expect_finite(name, tensor)


def given_pair(queries: Any, database: Any) -> tuple[Tensor, Tensor]:
    """Queries (q, ...) and a database (d, ...) of one shape, each as `given_descriptors`."""
    database = given_descriptors("database", database)
    queries = given_descriptors(
        "queries", queries, database.shape[1:], others="those of the database"
    )
    if queries.device != database.device:
        raise DataError(
            f"queries: on {queries.device}, but the database is on {database.device}; expected "
            "both on one device"
        )
    return queries, database


def _by(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape)) if len(shape) > 1 else f"{math.prod(shape)} numbers"
