"""Numbers in text files: decimal digits alone. Python's own reading takes more, such as 1_000."""

import re

_WHOLE = re.compile(r"[-+]?[0-9]{1,19}")
_REAL = re.compile(
    r"[-+]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|inf|nan)", re.IGNORECASE
)


def whole_number(text: str) -> int:
    """The whole number of up to 19 digits. Raises ValueError for other text.

    >>> whole_number("1_000")
    Traceback (most recent call last):
    ValueError: no whole number
    """
    if not _WHOLE.fullmatch(text):
        raise ValueError("no whole number")
    return int(text)


def real_number(text: str) -> float:
    """The number, which may be infinite or NaN. Raises ValueError for other text.

    >>> real_number("1e-05")
    1e-05
    >>> real_number("٣")
    Traceback (most recent call last):
    ValueError: no number
    """
    if not _REAL.fullmatch(text):
        raise ValueError("no number")
    return float(text)
