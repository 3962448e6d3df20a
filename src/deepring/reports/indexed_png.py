"""Small images of few colours as PNG, the same bytes every time."""

import base64
import struct
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Colour = tuple[int, int, int]


def indexed_png(
    image: NDArray[np.integer], palette: Sequence[Colour], *, clear: bool = False
) -> bytes:
    """An image (h, w) of numbers of colours as a file; up to 16 colours take half a byte each.

    Args:
        image: the first row is the upper one.
        palette: up to 16 colours of red, green and blue, 0 to 255.
        clear: whether the first colour is transparent.
    """
    depth = 1 if len(palette) <= 2 else 4
    height, width = image.shape
    bits = np.unpackbits(image.astype(np.uint8)[..., None], axis=-1)[..., 8 - depth :]
    packed = np.packbits(bits.reshape(height, width * depth), axis=1)
    rows = np.insert(packed, 0, 0, axis=1)  # each row begins with its filter: none
    header = struct.pack(">IIBBBBB", width, height, depth, 3, 0, 0, 0)
    parts = [(b"IHDR", header), (b"PLTE", bytes(np.array(palette, np.uint8).ravel()))]
    if clear:
        parts.append((b"tRNS", b"\0"))
    parts += [(b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(*part) for part in parts)


def data_uri(png: bytes) -> str:
    """The file as an address that holds all of it."""
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


def _chunk(name: bytes, content: bytes) -> bytes:
    check = zlib.crc32(name + content)
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", check)
