"""Point clouds in LAS and LAZ files, read by laspy."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.data.scans.content import ContentError

#: Points read at a time.
_CHUNK = 1 << 20


def las_points(path: Path) -> int:
    """The number of points that the header states. Raises ContentError for another type of file."""
    with _opened(path) as file:
        return int(file.header.point_count)


def las_chunks(path: Path) -> Iterator[NDArray[np.float64]]:
    """The points (n, 3) float64 of a file, scaled and shifted as its header says, in chunks.

    Raises ContentError for a file that is damaged or has less points than its header says.
    """
    found = 0
    with _opened(path) as file:
        expected = int(file.header.point_count)
        chunks = file.chunk_iterator(_CHUNK)
        while found < expected:
            points = _next(chunks, found, expected)
            found += len(points)
            yield points
    if found != expected:
        raise ContentError(f"{found} points of {expected} in its header")


def _next(chunks: Any, found: int, expected: int) -> NDArray[np.float64]:
    try:
        record = next(chunks, None)
        if record is not None and len(record):
            columns = (record.x, record.y, record.z)
            return np.stack([np.asarray(column, dtype=np.float64) for column in columns], axis=1)
    except Exception:  # whatever the decoders raise, panics of the compiled one among them
        raise ContentError(f"damaged or cut short after {found} points of {expected}") from None
    raise ContentError(f"{found} points of {expected} in its header")


def _opened(path: Path) -> Any:
    laspy = checks.installed("cloud", "laspy", "laspy", "las")
    source = path.open("rb")
    try:
        file = laspy.open(source)
        _expect_size(path, file.header)
        return file
    except (ContentError, OSError):
        source.close()
        raise
    except Exception:  # see above
        source.close()
        raise ContentError("no LAS header, or a damaged one") from None


def _expect_size(path: Path, header: Any) -> None:
    """Raise ContentError where a file that is not compressed is too short for its points."""
    scales = np.asarray(header.scales)
    if not (np.isfinite(scales).all() and (scales != 0).all()):
        raise ContentError(f"scale factors {', '.join(f'{scale:g}' for scale in scales)}")
    if header.are_points_compressed:
        return
    end = int(header.offset_to_point_data) + int(header.point_count) * int(header.point_format.size)
    size = path.stat().st_size
    if size < end:
        raise ContentError(f"{size} bytes, {end} expected for the {header.point_count} points")
