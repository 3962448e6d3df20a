"""JSON as the package writes it: what several programs read in several ways is refused."""

import json
import math
from collections import Counter
from typing import Any

from deepring.errors import DataError
from deepring.text import shown

#: Lists and objects within each other; no file of the package reaches a third of it.
DEPTH = 64

#: Whole numbers in a file fit into 64 bits.
_LARGEST = 2**63 - 1


def read_json(text: str | bytes) -> Any:
    """The value of a JSON text, UTF-8 if it is bytes.

    Raises DataError for anything else, for a name that is given twice, numbers that are not finite
    or whole numbers beyond 64 bits, and for more than `DEPTH` levels.

    >>> read_json('{"fit": 0.25}')
    {'fit': 0.25}
    >>> read_json('{"fit": 0.25, "fit": 0.0}')
    Traceback (most recent call last):
    deepring.errors.DataError: JSON: 'fit' twice, expected each name once
    """
    try:
        value = json.loads(
            text,
            object_pairs_hook=_once,
            parse_constant=_refused,
            parse_int=_whole,
            parse_float=_finite,
        )
    except RecursionError:
        raise DataError(f"JSON: nested too deeply, expected at most {DEPTH} levels") from None
    except DataError:
        raise
    except ValueError:
        raise DataError("JSON: a text that is none, expected a whole JSON text") from None
    if _is_deeper(value, DEPTH):
        raise DataError(f"JSON: nested too deeply, expected at most {DEPTH} levels")
    return value


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        twice, _ = Counter(name for name, _ in pairs).most_common(1)[0]
        raise DataError(f"JSON: {shown(twice, 80)} twice, expected each name once")
    return values


def _refused(word: str) -> Any:
    raise DataError(f"JSON: {word}, expected finite numbers")


def _whole(digits: str) -> int:
    if len(digits) > 20 or abs(int(digits)) > _LARGEST:
        raise DataError(f"JSON: {shown(digits, 40)}, expected whole numbers of 64 bits")
    return int(digits)


def _finite(digits: str) -> float:
    number = float(digits)
    if not math.isfinite(number):
        raise DataError(f"JSON: {shown(digits, 40)}, expected finite numbers")
    return number


def _is_deeper(value: Any, depth: int) -> bool:
    level = [value]
    for _ in range(depth + 1):
        nested = [one for one in level if isinstance(one, dict | list)]
        if not nested:
            return False
        level = [
            each for one in nested for each in (one.values() if isinstance(one, dict) else one)
        ]
    return True
