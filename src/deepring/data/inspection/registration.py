"""The planar motion between two scans, found in their images from above."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.session import Points

#: Images from above: metres a cell, reach of an image, cells of the padded transform, and the
#: largest shift of two images that is tried.
CELL, REACH, PADDED, SHIFT = 1.0, 40.0, 128, 24
#: Metres: what rises more within a cell is no ground; higher, it must have points between; closer
#: points are of the vehicle itself.
RISE, STOREY, BLIND = 0.5, 1.5, 2.5
#: Turns that are tried, radians; so are the expected turn and its opposite.
TURNS = np.radians(np.arange(-60.0, 61.0, 3.0)).astype(np.float64)
#: A peak is clear if it is so many times as high as any other. Of 1310 pairs of good drives, real
#: and simulated, 1305 are clear.
CLEAR = 1.3
#: Cells around a peak, and radians, that belong to it.
_AROUND, _TURN_AROUND = 3, math.radians(10)

Cells = NDArray[np.float64]
"""(m, 2) metres: middles of the cells in which something stands out."""


class Planar(NamedTuple):
    """Pose of the second scan of a pair in the frame of the first, both level."""

    x: float
    y: float
    yaw: float

    def distance(self, other: "Planar") -> float:
        """Metres between the positions."""
        return math.hypot(self.x - other.x, self.y - other.y)

    def turn(self, other: "Planar") -> float:
        """Degrees between the headings, at least 0."""
        return abs(math.degrees(math.remainder(self.yaw - other.yaw, 2 * math.pi)))


def planar_between(first: NDArray[np.float64], second: NDArray[np.float64]) -> Planar:
    """Planar pose of one scan in the level frame of another, from their poses (4, 4)."""
    yaw, other = (math.atan2(pose[1, 0], pose[0, 0]) for pose in (first, second))
    dx, dy = second[:2, 3] - first[:2, 3]
    c, s = math.cos(yaw), math.sin(yaw)
    return Planar(
        float(c * dx + s * dy),
        float(c * dy - s * dx),
        math.remainder(other - yaw, 2 * math.pi),
    )


def standing_cells(points: Points, pose: NDArray[np.float64]) -> Cells:
    """The cells in which points (n, 3) of a scan rise above the ground, in its level frame."""
    yaw = math.atan2(pose[1, 0], pose[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    tilt = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ pose[:3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        level = points @ tilt.T.astype(np.float32)
        distance = np.hypot(level[:, 0], level[:, 1])
        level = level[(distance < REACH) & (distance > BLIND) & np.isfinite(level[:, 2])]
    side = int(2 * REACH / CELL)
    i, j = np.floor((level[:, :2].T + REACH) / CELL).astype(np.int64).clip(0, side - 1)
    cell = i * side + j
    low, high = np.full(side**2, np.inf), np.full(side**2, -np.inf)
    np.minimum.at(low, cell, level[:, 2])
    np.maximum.at(high, cell, level[:, 2])
    # Floor and ceiling, or ground and a crown, are no wall: that has something between.
    third = (high - low)[cell] / 3
    between = (level[:, 2] >= low[cell] + third) & (level[:, 2] <= high[cell] - third)
    wall = np.bincount(cell[between], minlength=side**2) > 0
    cells = np.flatnonzero((high > low + RISE) & (wall | (high < low + STOREY)))
    return (np.column_stack(np.divmod(cells, side)) + 0.5) * CELL - REACH


class Registration(NamedTuple):
    """How two scans fit best, and as given."""

    found: Planar
    """The pose that fits best."""
    clear: bool
    """Whether nothing else fits nearly as well."""
    score: float
    """Correlation of the images as found, at most 1: some 0.5 if it is right, 0.1 by chance."""
    given_score: float
    """The same as given."""


def register(a: Cells, b: Cells, given: Planar) -> Registration:
    """Find the pose at which cells ``b`` fit on ``a`` best, whatever the ``given`` pose."""
    turns = np.array([*TURNS, -given.yaw, given.yaw])
    curves = _correlations(a, b, turns)
    heights = curves.max(axis=(1, 2))
    best = int(heights.argmax())
    i, j = np.unravel_index(int(curves[best].argmax()), curves[best].shape)
    away = np.abs([math.remainder(turn - turns[best], 2 * math.pi) for turn in turns])
    others = heights[away > _TURN_AROUND]
    rest = curves[best].copy()
    rest[_around(int(i), _AROUND), _around(int(j), _AROUND)] = 0
    rival = max(float(rest.max()), float(others.max()))
    x, y = ((k - SHIFT + _vertex(line)) * CELL for k, line in _lines(curves[best], int(i), int(j)))
    u, v = round(given.x / CELL) + SHIFT, round(given.y / CELL) + SHIFT
    near = curves[-1][_around(u, 1), _around(v, 1)]
    score = float(near.max()) if near.size else 0.0
    found = Planar(x, y, float(turns[best]))
    height = float(heights[best])
    return Registration(found, height >= CLEAR * rival, height, score)


def _around(k: int, reach: int) -> slice:
    return slice(max(k - reach, 0), max(k + reach + 1, 0))


def _lines(curve: NDArray[np.float32], i: int, j: int) -> list[tuple[int, NDArray[np.float32]]]:
    """Each index of a peak, with the three values around it, cut off at the border."""
    return [(i, curve[_around(i, 1), j]), (j, curve[i, _around(j, 1)])]


def _vertex(line: NDArray[np.float32]) -> float:
    """Peak of the parabola through three values, in steps from the middle."""
    if len(line) != 3:
        return 0.0
    before, middle, after = (float(value) for value in line)
    bend = 2 * middle - before - after
    return (after - before) / (2 * bend) if bend > 0 else 0.0


def _correlations(a: Cells, b: Cells, turns: NDArray[np.float64]) -> NDArray[np.float32]:
    """Correlations (t, s, s) of ``a`` with ``b`` turned, over shifts of ``b``, in cells."""
    from scipy import fft

    first = _half_whitened(_images(a, np.zeros(1)))
    second = _half_whitened(_images(b, turns))
    curves = fft.irfft2(first * second.conj(), s=(PADDED, PADDED)) * PADDED**2
    shifted: NDArray[np.float32] = np.roll(curves, (SHIFT, SHIFT), axis=(1, 2))
    return shifted[:, : 2 * SHIFT + 1, : 2 * SHIFT + 1]


def _images(cells: Cells, turns: NDArray[np.float64]) -> NDArray[np.float32]:
    """Images (t, padded, padded) of cells, turned; each is shared among the four around it."""
    side = int(2 * REACH / CELL)
    c, s = np.cos(turns)[:, None], np.sin(turns)[:, None]
    x = (c * cells[:, 0] - s * cells[:, 1] + REACH) / CELL - 0.5
    y = (s * cells[:, 0] + c * cells[:, 1] + REACH) / CELL - 0.5
    i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    u, v = x - i, y - j
    image = np.arange(len(turns))[:, None] * PADDED**2
    total = np.zeros(len(turns) * PADDED**2, dtype=np.float64)
    for di, share_i in ((0, 1 - u), (1, u)):
        for dj, share_j in ((0, 1 - v), (1, v)):
            inside = (i + di >= 0) & (i + di < side) & (j + dj >= 0) & (j + dj < side)
            index = (image + (i + di) * PADDED + j + dj)[inside]
            total += np.bincount(index, (share_i * share_j)[inside], len(total))
    return total.reshape(-1, PADDED, PADDED).astype(np.float32)


def _half_whitened(images: NDArray[np.float32]) -> NDArray[np.complex64]:
    """Spectra, blurred, divided by the root of their sizes, and of unit norm."""
    from scipy import fft

    spectra = fft.rfft2(images) * _blur()
    size = np.abs(spectra)
    spectra /= np.sqrt(np.maximum(size, 1e-12))
    # |spectrum|² is the size now; all but the first and last column stand for two.
    power = 2 * size.sum(axis=(1, 2)) - size[..., 0].sum(axis=1) - size[..., -1].sum(axis=1)
    spectra /= np.sqrt(np.maximum(power, 1e-12))[:, None, None]
    return np.asarray(spectra, dtype=np.complex64)


def _blur() -> NDArray[np.float32]:
    """Transfer function of a Gaussian of 0.6 cells, without the mean."""
    squared = np.fft.fftfreq(PADDED)[:, None] ** 2 + np.fft.rfftfreq(PADDED)[None] ** 2
    transfer = np.exp(-2 * (math.pi * 0.6) ** 2 * squared)
    transfer[0, 0] = 0.0
    return np.asarray(transfer, dtype=np.float32)


def fit_of(a: Cells, b: Cells, pose: Planar) -> float:
    """Share of the cells ``b`` at ``pose`` within the image of ``a`` that lie beside one of it."""
    side = int(2 * REACH / CELL) + 2
    image = np.zeros((side, side), dtype=np.bool_)
    i, j = np.floor((a.T + REACH) / CELL).astype(np.int64) + 1
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            image[i + di, j + dj] = True
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    moved = b @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y)
    moved = moved[np.hypot(*moved.T) < REACH - CELL]
    if not len(moved):
        return 0.0
    i, j = np.floor((moved.T + REACH) / CELL).astype(np.int64) + 1
    return float(image[i, j].mean())
