"""Other readings of scans whose points are not plausible: types, widths, units, axes."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.data.inspection.figures import ScanFigures, measure_scan
from deepring.data.inspection.scans import figure_findings, shows_ground
from deepring.data.readers import binary_formats
from deepring.data.readers.reader import BinaryScans
from deepring.data.scans.names import ending_of
from deepring.errors import DeepringError

Coordinates = NDArray[np.floating]

#: Values of one point that are tried: x, y, z and up to seven others.
WIDTHS = tuple(range(3, 11))
_TYPES = {
    "float32": "<f4",
    "float64": "<f8",
    "big-endian float32": ">f4",
    "big-endian float64": ">f8",
    "float16": "<f2",
}
#: Metres in one unit.
UNITS = {
    "millimetres": 0.001,
    "centimetres": 0.01,
    "feet": 0.3048,
    "inches": 0.0254,
    "kilometres": 1000.0,
}
#: Metres of height that another reading must show.
LEAST_SPAN = 1.0
#: Metres from a sensor to half of the points of most scans.
USUAL_DISTANCE = 15.0
#: Axes of other frames, as rows that give x forward, y left, z up; all right-handed.
AXES = {
    "x forward, y right, z down": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "a camera's, x right, y down, z forward": [[0, 0, 1], [-1, 0, 0], [0, -1, 0]],
    "x right, y up, z backward": [[0, 0, -1], [-1, 0, 0], [0, 1, 0]],
    "z forward, x up": [[0, 0, 1], [0, 1, 0], [1, 0, 0]],
    "x down, y left, z forward": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
}


@dataclass(frozen=True)
class Reading:
    """Another reading of the same scans, with which they are plausible."""

    name: str
    advice: str


def plausible(figures: ScanFigures, ground_z: float) -> bool:
    """Nothing is doubtful, the ground lies where it should, and something stands on it."""
    stands = figures.span_z > LEAST_SPAN
    return stands and shows_ground(figures) and not figure_findings(figures, ground_z)


def other_axes(scans: Sequence[Coordinates], ground_z: float) -> Reading | None:
    """The axes with which most of the scans, each (n, 3), are plausible, or None."""
    for name, rows in AXES.items():
        turn = np.array(rows, dtype=np.float64).T
        if most_plausible([points @ turn for points in scans], ground_z):
            return Reading(
                f"points with axes {name}",
                "turn them to x forward, y left, z up (custom drives: set up, or sensor_in_body "
                "where the poses are those of the vehicle)",
            )
    return None


def other_unit(
    scans: Sequence[Coordinates], ground_z: float, units: Mapping[str, float] = UNITS
) -> Reading | None:
    """The unit with which most of the scans, each (n, 3), are plausible, or None.

    Of several (with the ground at 0 it agrees in any unit), that with the most usual distances.
    """
    fitting = {
        abs(math.log(metres * measure_scan(scans[0]).distance / USUAL_DISTANCE)): (name, metres)
        for name, metres in units.items()
        if most_plausible([points * metres for points in scans], ground_z)
    }
    if not fitting:
        return None
    name, metres = fitting[min(fitting)]
    return Reading(f"points in {name}", f"multiply them by {metres:g}")


def most_plausible(scans: Sequence[Coordinates], ground_z: float) -> bool:
    """Whether most of the scans, each (n, 3), are plausible."""
    fits = sum(plausible(measure_scan(points), ground_z) for points in scans)
    return 2 * fits > len(scans)


def other_record(
    files: Sequence[Path], format: str, ground_z: float, turn: Coordinates
) -> Reading | None:
    """The type and width, or the format, with which all of the .bin files are plausible.

    ``turn`` (3, 3) turns their axes to z up. A reading with the ground where it should be comes
    before one without a ground. None if there is none.
    """
    without_ground = None
    for reading, height, read in _readings(format, turn):
        expected = ground_z if height is None else height
        figures = _figures_of(read, files)
        if not figures or any(figure_findings(one, expected, single=True) for one in figures):
            continue
        if all(map(shows_ground, figures)):
            return reading
        without_ground = without_ground or reading
    return without_ground


def intensity_first(files: Sequence[Path], ground_z: float, turn: Coordinates) -> Reading | None:
    """The columns intensity, x, y, z, if most of the .bin and .npy files are plausible so, or None.

    The files can be read as they are. ``turn`` (3, 3) turns their axes to z up.
    """
    scans = [rows[:, 1:4] @ turn for file in files if (rows := _four_columns(file)) is not None]
    if not scans or not most_plausible(scans, ground_z):
        return None
    return Reading(
        "points with x, y and z in the second to fourth column",
        "write x, y and z into the first three columns, the intensity after them",
    )


def _four_columns(file: Path) -> Coordinates | None:
    """The values (n, 4) of float32 records, or of an array that has so many columns."""
    if ending_of(file) == ".bin":
        content = file.read_bytes()
        return None if len(content) % 16 else np.frombuffer(content, "<f4").reshape(-1, 4)
    if ending_of(file) != ".npy":
        return None
    array = np.load(file, allow_pickle=False)
    return np.asarray(array, dtype=np.float64) if array.ndim == 2 and array.shape[1] == 4 else None


def _figures_of(read: "_Read", files: Sequence[Path]) -> list[ScanFigures]:
    """Figures of all files, or none if one cannot be read or is not plausible in itself."""
    measured = []
    for file in files:
        with np.errstate(invalid="ignore", over="ignore"):  # of wrong types
            points = read(file)
        figures = None if points is None else measure_scan(points)
        if figures is None or figure_findings(figures, None, single=True):
            return []
        measured.append(figures)
    return measured


_Read = Callable[[Path], Coordinates | None]

_REWRITE = (
    "write points as float32 x, y, z, intensity, little-endian (format kitti), or as .npy files "
    "with x, y, z in the first columns"
)


def _readings(format: str, turn: Coordinates) -> Iterator[tuple[Reading, float | None, _Read]]:
    """Readings with z of the ground, if they have their own, and the points of a file."""
    formats = binary_formats()
    for name, other in formats.items():
        if other.records != formats[format].records:
            reading = Reading(f"format {name}", f"use format {name}")
            yield reading, other.ground_z, partial(_as_format, other)
    for label, type in _TYPES.items():
        for width in WIDTHS:
            name = f"{label} with {width} values a point"
            yield Reading(name, _REWRITE), None, partial(_as_values, type, width, turn, False)
        for width in (3, 4):
            name = f"{label} with {width} columns, all x before all y"
            yield Reading(name, _REWRITE), None, partial(_as_values, type, width, turn, True)


def _as_format(format: BinaryScans, file: Path) -> Coordinates | None:
    try:
        return format.read(file)
    except DeepringError:
        return None


def _as_values(
    type: str, width: int, turn: Coordinates, by_column: bool, file: Path
) -> Coordinates | None:
    kind = np.dtype(type)
    content = file.read_bytes()
    if len(content) % (kind.itemsize * width):
        return None
    values = np.frombuffer(content, kind).astype(np.float64)
    rows = values.reshape(width, -1).T if by_column else values.reshape(-1, width)
    return np.asarray(rows[:, :3] @ turn)
