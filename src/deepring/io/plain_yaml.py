"""YAML of plain values from anybody: it makes no objects, and stands for no more than is bearable.

The library shares what an alias repeats, so that a few lines may hold a billion values. Whoever
copies them runs out of memory.
"""

import math
from typing import Any

import yaml

from deepring.errors import DataError

#: Values of a file; more are refused.
MOST_VALUES = 100_000


def plain_yaml(text: str | bytes) -> Any:
    """The values of a YAML text.

    Raises DataError, without the name of the file, for anything but plain values, and for aliases
    that stand for more than `MOST_VALUES`.

    >>> plain_yaml("a: [1, x]")
    {'a': [1, 'x']}
    """
    try:
        values = yaml.safe_load(text)
        size = expanded_size(values)
    except Exception as error:  # tags and numbers that are none raise many types beside YAMLError
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}" if mark is not None else "some line"
        raise DataError(f"invalid YAML at {where}; correct that line") from error
    if size > MOST_VALUES:
        raise DataError(
            f"aliases that stand for more than {MOST_VALUES} values; expected a few: write them out"
        )
    return values


def expanded_size(value: Any) -> float:
    """The number of values within a value, itself included, as if every alias were written out.

    Infinite for a value that holds itself.

    >>> row = [0, 0, 0]
    >>> expanded_size({"a": row, "b": [row, row]})
    16
    """
    return _size(value, {})


def _size(value: Any, known: dict[int, float]) -> float:
    if not isinstance(value, dict | list | tuple | set):
        return 1
    if id(value) in known:
        return known[id(value)]
    known[id(value)] = math.inf  # until it is known: met within itself, it has no end
    inner = value.values() if isinstance(value, dict) else value
    known[id(value)] = 1 + sum(_size(each, known) for each in inner)
    if isinstance(value, dict):
        known[id(value)] += len(value)
    return known[id(value)]
