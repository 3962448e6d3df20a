"""What checks the annotated shapes of arrays while the tests run (addopts in pyproject.toml)."""

from collections.abc import Callable
from typing import Any, Literal, get_origin

from beartype import BeartypeConf, beartype


def check_shapes(function: Callable[..., Any]) -> Callable[..., Any]:
    """Check a function's arguments and results against their annotations.

    A name that is none of a ``Literal`` passes: the function refuses it with an error of its own,
    which is tested. An int passes for a float, as for mypy.
    """
    for name, hint in function.__annotations__.items():
        if get_origin(hint) is Literal:
            function.__annotations__[name] = Any
    return beartype(conf=BeartypeConf(is_pep484_tower=True))(function)
