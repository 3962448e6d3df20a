"""How many values a YAML text stands for: aliases within aliases stand for more than is written.

The library shares what an alias repeats, so that a few lines may hold a billion values. Whoever
copies them runs out of memory.
"""

import math
from typing import Any

#: Values of a file; more are refused.
MOST_VALUES = 100_000


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
