"""A cloud of any size as a binary .pcd, written part by part."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np


def write_pcd(file: Path, parts: Iterable[np.ndarray], width: int) -> int:
    """Write points (n, 3) of all parts as floats of ``width`` bytes, and return their number."""
    body, count = file.with_suffix(".body"), 0
    with body.open("wb") as out:
        for points in parts:
            points.astype(f"<f{width}").tofile(out)
            count += len(points)
    sizes = " ".join([str(width)] * 3)
    head = (
        f"VERSION 0.7\nFIELDS x y z\nSIZE {sizes}\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {count}\nHEIGHT 1\nPOINTS {count}\nDATA binary\n"
    )
    with file.open("wb") as out, body.open("rb") as points_file:
        out.write(head.encode())
        while block := points_file.read(1 << 24):
            out.write(block)
    body.unlink()
    return count
