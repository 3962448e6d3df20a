"""Checks of single values: each returns the value, or raises ConfigError.

Every message states the name, the value, and what was expected.
"""

import math
from collections.abc import Collection
from typing import Any, TypeVar, get_args

from deepring.errors import ConfigError

T = TypeVar("T")


def one_of(name: str, value: T, choices: Any) -> T:
    """Return the value if it is among ``choices``, a collection or a ``Literal`` type.

    >>> one_of("similarity", "l2", ("l2", "cosine"))
    'l2'
    >>> one_of("similarity", "l1", ("l2", "cosine"))
    Traceback (most recent call last):
    deepring.errors.ConfigError: similarity: 'l1', expected one of l2, cosine
    """
    options: Collection[Any] = get_args(choices) or choices
    # Not ``value in options``: a list cannot be looked up in a set, and True equals 1.
    if not any(type(value) is type(option) and value == option for option in options):
        raise ConfigError(f"{name}: {value!r}, expected one of {', '.join(map(str, options))}")
    return value


def number(name: str, value: float, unit: str = "") -> float:
    """Return the value if it is a finite number. ``unit`` appears in the message.

    >>> number("ground_z", math.nan, "metres")
    Traceback (most recent call last):
    deepring.errors.ConfigError: ground_z: nan, expected a finite number of metres
    """
    if not is_number(value):
        raise ConfigError(f"{name}: {value!r}, expected {_number(unit, 'finite ')}")
    return value


def positive(name: str, value: float, unit: str = "") -> float:
    """Return the value if it is a finite number above 0. ``unit`` appears in the message.

    >>> positive("reach", 0, "metres")
    Traceback (most recent call last):
    deepring.errors.ConfigError: reach: 0, expected a number of metres above 0
    """
    if not is_number(value) or not value > 0:
        raise ConfigError(f"{name}: {value!r}, expected {_number(unit)} above 0")
    return value


def at_least(name: str, value: float, least: float, unit: str = "") -> float:
    """Return the value if it is a finite number of at least ``least``.

    >>> at_least("spacing", -1.0, 0, "metres")
    Traceback (most recent call last):
    deepring.errors.ConfigError: spacing: -1.0, expected a number of metres of at least 0
    """
    if not is_number(value) or value < least:
        raise ConfigError(f"{name}: {value!r}, expected {_number(unit)} of at least {least:g}")
    return value


def count(name: str, value: int, least: int = 1) -> int:
    """Return the value if it is a whole number of at least ``least``.

    >>> count("candidates", 2.0)
    Traceback (most recent call last):
    deepring.errors.ConfigError: candidates: 2.0, expected a whole number of at least 1
    """
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise ConfigError(f"{name}: {value!r}, expected a whole number of at least {least}")
    return value


def share(name: str, value: float) -> float:
    """Return the value if it is a number in [0, 1].

    >>> share("candidate_share", 1)
    1
    """
    if not is_number(value) or not 0 <= value <= 1:
        raise ConfigError(f"{name}: {value!r}, expected a share in [0, 1]")
    return value


def fraction(name: str, value: float) -> float:
    """Return the value if it is a number between 0 and 1, both excluded.

    >>> fraction("precision", 1.0)
    Traceback (most recent call last):
    deepring.errors.ConfigError: precision: 1.0, expected a share between 0 and 1
    """
    if not is_number(value) or not 0 < value < 1:
        raise ConfigError(f"{name}: {value!r}, expected a share between 0 and 1")
    return value


def interval(name: str, value: Any, unit: str = "") -> tuple[float, float]:
    """Return the pair (low, high) of finite numbers if low < high.

    >>> interval("height", [-5, 20], "metres")
    (-5, 20)
    """
    pair = tuple(value) if isinstance(value, list | tuple) else ()
    if len(pair) != 2 or not all(map(is_number, pair)) or not pair[0] < pair[1]:
        suffix = f" in {unit}" if unit else ""
        raise ConfigError(f"{name}: {value!r}, expected [low, high]{suffix} with low < high")
    return pair


def of_type(name: str, value: T, kind: type) -> T:
    """Return the value if it is an instance of ``kind``."""
    if not isinstance(value, kind):
        raise ConfigError(f"{name}: a {type(value).__name__}, expected a {kind.__name__}")
    return value


def is_number(value: Any) -> bool:
    """Whether the value is a finite int or float, and not a bool.

    >>> [is_number(value) for value in (0, -1.5, True, math.inf, "1")]
    [True, True, False, False, False]
    """
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(unit: str, which: str = "") -> str:
    return f"a {which}number of {unit}" if unit else f"a {which}number"
