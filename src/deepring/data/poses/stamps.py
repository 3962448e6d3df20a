"""Time stamps: whole nanoseconds, from and to decimal seconds without rounding."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

NANOSECONDS = 1_000_000_000  # in a second

_DECIMAL = re.compile(r"([+-]?)([0-9]*)(?:\.([0-9]*))?(?:[eE]([+-]?[0-9]{1,6}))?")
_MOST = 2**63
#: Names that are stamps since 1970: nanoseconds, microseconds, or seconds with decimals.
_NAMES = (
    (re.compile(r"[12][0-9]{18}"), "e-9"),
    (re.compile(r"[12][0-9]{15}"), "e-6"),
    (re.compile(r"[12][0-9]{9}[.][0-9]{1,9}"), ""),
)
#: Stamps in other units, by their least size if they were seconds: those since 1970, and 1973.
_UNITS = ((1e17, "nanoseconds"), (1e14, "microseconds"), (1e11, "milliseconds"))


def nanoseconds_of(seconds: str) -> int:
    """Nanoseconds of decimal ``seconds``: exact up to nine decimals, then rounded half to even.

    Raises ValueError, with the reason, for text that is no number and for values outside int64.

    >>> nanoseconds_of("1566279795.718079314")
    1566279795718079314
    >>> nanoseconds_of("-1.5e-3")
    -1500000
    >>> nanoseconds_of("1566279795718079314")
    Traceback (most recent call last):
    ValueError: 1566279795718079314 would be nanoseconds, expected seconds
    """
    text = seconds.strip()
    match = _DECIMAL.fullmatch(text)
    sign, whole, fraction, exponent = match.groups() if match else ("", "", "", "")
    digits = (whole or "") + (fraction or "")
    if not digits:
        raise ValueError(f"{text[:40]!r} is no number of seconds")
    shift = 9 + int(exponent or 0) - len(fraction or "")
    value = _shifted(int(digits), shift) if len(digits) < 4000 else 2 * _MOST
    value = -value if sign == "-" else value
    if not -_MOST <= value < _MOST:
        raise ValueError(_too_large(text))
    return value


def _shifted(value: int, shift: int) -> int:
    """``value`` times ten to the ``shift``, rounded half to even."""
    if shift >= 0:
        return value * 10 ** min(shift, 40)  # beyond int64 in any case
    if -shift > 4000:
        return 0
    quotient, rest = divmod(value, 10**-shift)
    half = 10**-shift // 2
    return quotient + (rest > half or (rest == half and quotient % 2 == 1))


def _too_large(text: str) -> str:
    size = abs(float(text))
    unit = next((name for least, name in _UNITS if least <= size < 1e20), None)
    if unit is None:
        return f"{text[:40]} is out of range, expected seconds"
    return f"{text[:40]} would be {unit}, expected seconds"


def stamps_in_names(files: Sequence[Path]) -> NDArray[np.int64] | None:
    """Nanoseconds (n,) in the names of scans, or None unless each name is a time since 1970.

    >>> stamps_in_names([Path("1566279795718079.bin"), Path("1566279795818079.bin")]).tolist()
    [1566279795718079000, 1566279795818079000]
    """
    for pattern, unit in _NAMES:
        names = [file.stem for file in files]
        if names and all(pattern.fullmatch(name) for name in names):
            return np.array([nanoseconds_of(name + unit) for name in names], dtype=np.int64)
    return None


def seconds_text(stamp: int) -> str:
    """Seconds of a stamp in nanoseconds, with nine decimals: exact.

    >>> seconds_text(1566279795718079314)
    '1566279795.718079314'
    """
    stamp = int(stamp)
    whole, fraction = divmod(abs(stamp), NANOSECONDS)
    return f"{'-' if stamp < 0 else ''}{whole}.{fraction:09d}"
