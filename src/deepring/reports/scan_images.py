"""Pictures of scans and descriptors as small SVG elements; a scan is on the page once."""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from deepring.reports.escaping import escaped
from deepring.reports.indexed_png import Colour, data_uri, indexed_png
from deepring.reports.lie import Lie

#: Colours of a query's points and of a place's, which can be told from each other on white and on
#: dark paper.
QUERY: Colour = (226, 98, 16)
PLACE: Colour = (36, 132, 208)

#: Sixteen steps of matplotlib's magma.
_MAGMA: tuple[Colour, ...] = (
    *((0, 0, 4), (12, 9, 38), (33, 17, 75), (61, 15, 113), (87, 21, 126), (112, 31, 129)),
    *((138, 41, 129), (166, 49, 125), (192, 58, 118), (217, 70, 107), (237, 90, 95)),
    *((249, 119, 93), (253, 150, 106), (254, 183, 130), (254, 217, 163), (252, 253, 191)),
)


def scan_image(name: str, image: NDArray[np.bool_], extent: float, colour: Colour) -> str:
    """A scan (n, n) from above as an element that others use by its name; x upwards, y left."""
    png = indexed_png(image[::-1, ::-1].astype(np.uint8), [(255, 255, 255), colour], clear=True)
    size = f'x="{-extent:g}" y="{-extent:g}" width="{2 * extent:g}" height="{2 * extent:g}"'
    return f'<image id="{name}" {size} href="{data_uri(png)}"/>'


def defined(images: Iterable[str]) -> str:
    """The images (`scan_image`) as elements of a page that are not shown until they are used."""
    return f'<svg class="images" aria-hidden="true"><defs>{"".join(images)}</defs></svg>'


def laid_out(name: str, extent: float, described: str) -> str:
    """One scan, its sensor in the middle."""
    return _view(f'<use href="#{name}"/>{_SENSOR}', extent, described)


def overlaid(place: str, query: str, lie: Lie, extent: float, described: str) -> str:
    """A query's scan laid over that of a place, as it lies there."""
    x, y = lie.position or (0.0, 0.0)
    # The drawing's x is -y of the scan, and its y is -x; angles of SVG are clockwise.
    where = f"translate({-y:.2f} {-x:.2f}) rotate({math.degrees(lie.turn):.2f})"
    inside = f'<use href="#{place}"/><g transform="{where}"><use href="#{query}"/>{_SENSOR}</g>'
    return _view(inside, extent, described)


def _view(inside: str, extent: float, described: str) -> str:
    box = f"{-extent:g} {-extent:g} {2 * extent:g} {2 * extent:g}"
    return (
        f'<svg class="scan" viewBox="{box}" role="img" aria-label="{escaped(described)}">'
        f'<circle class="reach" r="{extent:g}"/>{inside}</svg>'
    )


#: The sensor, which looks upwards.
_SENSOR = '<path class="sensor" d="M0-4.5L3 3H-3Z"/>'


def value_image(
    values: NDArray[np.float32], low: float, high: float, described: str, most: int = 64
) -> str:
    """An array (rows, columns) in colours from ``low`` to ``high``, dark to bright.

    Of more than ``most`` rows or columns neighbours are averaged.
    """
    small = _smaller(_smaller(values, 0, most), 1, most)
    steps = np.clip((small - low) / max(high - low, 1e-12), 0, 1) * (len(_MAGMA) - 1)
    png = indexed_png(steps.round().astype(np.uint8), _MAGMA)
    return f'<img class="values" src="{data_uri(png)}" alt="{escaped(described)}">'


def _smaller(values: NDArray[np.float32], axis: int, most: int) -> NDArray[np.float32]:
    """Means of neighbours along an axis, so that there are at most so many."""
    size = values.shape[axis]
    if size <= most:
        return values
    starts = np.linspace(0, size, most, endpoint=False).astype(int)
    counts = np.diff(np.append(starts, size))
    shape = (-1, 1) if axis == 0 else (1, -1)
    sums = np.add.reduceat(values, starts, axis=axis)
    return (sums / counts.reshape(shape)).astype(np.float32)
