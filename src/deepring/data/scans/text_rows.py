"""Rows of numbers in the text of a scan file: one point, or other row, in each line."""

import re
from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.content import ContentError

#: NaN and infinity as the runtime of Windows writes them, and NaN with a payload.
_NAN = re.compile(rb"(?<!\S)[-+]?(?:\d\.\d*#(?:QNAN|SNAN|IND)\d*|nan\(\w*\))(?!\S)", re.IGNORECASE)
_INF = re.compile(rb"(?<!\S)([-+]?)\d\.\d*#INF\d*(?!\S)", re.IGNORECASE)
#: Bytes that no text of numbers contains, some of which are spaces to a library.
_OTHER = re.compile(rb"[^\t\n\v\f\r -~]")


def text_rows(text: bytes, width: int) -> NDArray[np.float64]:
    """The rows (n, width) float64 of a text; empty lines are none.

    Raises ContentError with the first line that is not ``width`` numbers.
    """
    if not text.strip():
        return np.empty((0, width))
    if _OTHER.search(text):
        raise ContentError(_problem(text, width))
    if b"#" in text or b"(" in text:
        text = _INF.sub(rb"\1inf", _NAN.sub(b"nan", text))
    try:
        # Takes neither rows of different lengths, nor 1_0 for 10 as Python does.
        rows = np.loadtxt(BytesIO(text), comments=None, ndmin=2, encoding="latin-1")
    except ValueError:
        rows = np.empty((0, 0))
    if rows.shape[1] != width:
        raise ContentError(_problem(text, width))
    return np.asarray(rows, dtype=np.float64)


def _problem(text: bytes, width: int) -> str:
    for number, line in enumerate(text.splitlines(), start=1):
        values = line.split()
        if values and (len(values) != width or not all(map(_is_number, values))):
            shown = b" ".join(values)[:80].decode("latin-1")
            return f"line {number} after its header reads {shown!r}, not {width} numbers"
    return f"lines after its header other than {width} numbers"


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return not _OTHER.search(word) and b"_" not in word
