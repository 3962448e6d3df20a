"""NPY, versions 1 to 3: a header that is a Python dict, and the numbers of one array."""

import ast
import struct

from fuzz.decoders.points import Points, returns
from fuzz.files import UndecidedError, UndecodableError

_LETTERS = {
    **{"f4": "f", "f8": "d", "f2": "e", "i1": "b", "i2": "h", "i4": "i", "i8": "q"},
    **{"u1": "B", "u2": "H", "u4": "I", "u8": "Q"},
}


def decode(content: bytes) -> Points:
    """The first three columns of an array (n, 3) or wider."""
    if content[:6] != b"\x93NUMPY" or len(content) < 12 or content[6] not in (1, 2, 3):
        raise UndecodableError("no NPY header")
    wide = content[6] > 1
    (size,) = struct.unpack_from("<I" if wide else "<H", content, 8)
    start = 12 if wide else 10
    text = content[start : start + size].replace(b"\xa0", b" ")
    try:
        header = ast.literal_eval(text.decode("utf-8" if content[6] == 3 else "latin-1").strip())
        descr, fortran, shape = header["descr"], header["fortran_order"], header["shape"]
        known = set(header) == {"descr", "fortran_order", "shape"}
    except (ValueError, SyntaxError, KeyError, TypeError, MemoryError, RecursionError):
        raise UndecodableError("no NPY header") from None
    if len(text) != size or not known or type(fortran) is not bool:
        raise UndecodableError("no NPY header")
    if not isinstance(shape, tuple) or len(shape) != 2 or not all(type(n) is int for n in shape):
        raise UndecodableError("no two axes")
    rows, columns = shape
    if rows < 0 or columns < 3:
        raise UndecodableError("fewer than three columns")
    letter = _letter(descr)
    width = struct.calcsize(letter)
    body = content[start + size :]
    if len(body) != rows * columns * width:
        raise UndecodableError(f"{len(body)} bytes, not those of the header's shape")
    values = [value for (value,) in struct.iter_unpack(letter, body)]
    if fortran:
        return returns([values[k + c * rows] for c in range(3)] for k in range(rows))
    return returns(values[k * columns : k * columns + 3] for k in range(rows))


def _letter(descr: object) -> str:
    """The layout of one number."""
    if not isinstance(descr, str):
        raise UndecodableError("an array of records")
    order, kind = (descr[0], descr[1:]) if descr[:1] in ("<", ">", "|", "=") else ("=", descr)
    if kind not in _LETTERS:
        raise UndecidedError  # NumPy knows other names of its types, too
    return (">" if order == ">" else "<") + _LETTERS[kind]
