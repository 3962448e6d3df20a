"""Checks of single values: each returns the value, or raises ConfigError.

Every message states the name, the value, and what was expected.
"""

import math
import sys
from collections.abc import Collection
from importlib import import_module
from typing import Any, TypeVar, get_args

from deepring.errors import ConfigError
from deepring.text import shown

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
        raise ConfigError(f"{name}: {shown(value)}, expected one of {', '.join(map(str, options))}")
    return value


def number(name: str, value: float, unit: str = "") -> float:
    """Return the value if it is a finite number. ``unit`` appears in the message.

    >>> number("ground_z", math.nan, "metres")
    Traceback (most recent call last):
    deepring.errors.ConfigError: ground_z: nan, expected a finite number of metres
    """
    if not is_number(value):
        raise ConfigError(f"{name}: {shown(value)}, expected {_number(unit, 'finite ')}")
    return value


def positive(name: str, value: float, unit: str = "") -> float:
    """Return the value if it is a finite number above 0. ``unit`` appears in the message.

    >>> positive("reach", 0, "metres")
    Traceback (most recent call last):
    deepring.errors.ConfigError: reach: 0, expected a number of metres above 0
    """
    if not is_number(value) or not value > 0:
        raise ConfigError(f"{name}: {shown(value)}, expected {_number(unit)} above 0")
    return value


def at_least(name: str, value: float, least: float, unit: str = "") -> float:
    """Return the value if it is a finite number of at least ``least``.

    >>> at_least("spacing", -1.0, 0, "metres")
    Traceback (most recent call last):
    deepring.errors.ConfigError: spacing: -1.0, expected a number of metres of at least 0
    """
    if not is_number(value) or value < least:
        raise ConfigError(f"{name}: {shown(value)}, expected {_number(unit)} of at least {least:g}")
    return value


def between(name: str, value: float, least: float, most: float, unit: str = "") -> float:
    """Return the value if it is a number in [``least``, ``most``].

    >>> between("extent", 1e300, 0, 10_000, "metres")
    Traceback (most recent call last):
    deepring.errors.ConfigError: extent: 1e+300, expected a number of metres from 0 to 10000
    """
    if not is_number(value) or not least <= value <= most:
        raise ConfigError(
            f"{name}: {shown(value)}, expected {_number(unit)} from {least:g} to {most:g}"
        )
    return value


def count(name: str, value: int, least: int = 1, most: int | None = None) -> int:
    """Return the value if it is a whole number of at least ``least``, and at most ``most``.

    >>> count("candidates", 2.0)
    Traceback (most recent call last):
    deepring.errors.ConfigError: candidates: 2.0, expected a whole number of at least 1
    """
    whole = isinstance(value, int) and not isinstance(value, bool)
    if whole and most is not None and value > most:
        raise ConfigError(f"{name}: {shown(value)}, expected at most {most}")
    if not whole or value < least:
        raise ConfigError(f"{name}: {shown(value)}, expected a whole number of at least {least}")
    return value


def widths(name: str, values: Any) -> tuple[int, ...]:
    """Return the numbers of channels of a network's layers if there are 1 to 16, of 1 to 8192.

    >>> widths("encoder.widths", [8, 0])
    Traceback (most recent call last):
    deepring.errors.ConfigError: encoder.widths: [8, 0], expected 1 to 16 numbers from 1 to 8192
    """
    numbers = tuple(values) if isinstance(values, list | tuple) else ()
    whole = all(isinstance(one, int) and not isinstance(one, bool) for one in numbers)
    if not 1 <= len(numbers) <= 16 or not whole or not all(1 <= one <= 8192 for one in numbers):
        listed = shown(list(values) if isinstance(values, tuple) else values)
        raise ConfigError(f"{name}: {listed}, expected 1 to 16 numbers from 1 to 8192")
    return numbers


def share(name: str, value: float) -> float:
    """Return the value if it is a number in [0, 1].

    >>> share("candidate_share", 1)
    1
    """
    if not is_number(value) or not 0 <= value <= 1:
        raise ConfigError(f"{name}: {shown(value)}, expected a share in [0, 1]")
    return value


def fraction(name: str, value: float) -> float:
    """Return the value if it is a number between 0 and 1, both excluded.

    >>> fraction("precision", 1.0)
    Traceback (most recent call last):
    deepring.errors.ConfigError: precision: 1.0, expected a share between 0 and 1
    """
    if not is_number(value) or not 0 < value < 1:
        raise ConfigError(f"{name}: {shown(value)}, expected a share between 0 and 1")
    return value


def interval(name: str, value: Any, unit: str = "") -> tuple[float, float]:
    """Return the pair (low, high) of finite numbers if low < high.

    >>> interval("height", [-5, 20], "metres")
    (-5, 20)
    """
    pair = tuple(value) if isinstance(value, list | tuple) else ()
    if len(pair) != 2 or not all(map(is_number, pair)) or not pair[0] < pair[1]:
        suffix = f" in {unit}" if unit else ""
        raise ConfigError(f"{name}: {shown(value)}, expected [low, high]{suffix} with low < high")
    return pair


def of_type(name: str, value: T, kind: type) -> T:
    """Return the value if it is an instance of ``kind``."""
    if not isinstance(value, kind):
        raise ConfigError(f"{name}: a {type(value).__name__}, expected a {kind.__name__}")
    return value


def installed(name: str, module: str, package: str, extra: str) -> Any:
    """Return the module of an optional package, which ``pip install 'deepring[extra]'`` brings."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ConfigError(
            f"{name}: {package} is not installed, expected it; run pip install 'deepring[{extra}]'"
        ) from error


def is_number(value: Any) -> bool:
    """Whether the value is a finite int or float, and not a bool.

    >>> [is_number(value) for value in (0, -1.5, True, math.inf, "1")]
    [True, True, False, False, False]
    """
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    return math.isfinite(value) if isinstance(value, float) else abs(value) <= sys.float_info.max


def _number(unit: str, which: str = "") -> str:
    return f"a {which}number of {unit}" if unit else f"a {which}number"
