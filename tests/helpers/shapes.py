"""What checks the annotated shapes of arrays while the tests run (addopts in pyproject.toml)."""

from collections.abc import Callable
from typing import Any, get_args

from beartype import beartype
from jaxtyping import AbstractArray


def check_shapes(function: Callable[..., Any]) -> Callable[..., Any]:
    """Check those arguments and results of a function whose annotations state a shape.

    Others pass: a wrong name or number is for the function itself to refuse, which is tested.
    """
    for name, hint in function.__annotations__.items():
        if not states_shape(hint):
            function.__annotations__[name] = Any
    return beartype(function)


def states_shape(hint: Any) -> bool:
    """Whether the annotation is, or contains, one such as ``Float[Tensor, "batch theta"]``."""
    is_array = isinstance(hint, type) and issubclass(hint, AbstractArray)
    return is_array or any(states_shape(part) for part in get_args(hint))
