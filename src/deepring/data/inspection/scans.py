"""Whether the points of scans can be those of a LiDAR above the ground, in metres with z up.

Thresholds are set from scans of KITTI (HDL-64E), NCLT (HDL-32E), RELLIS (OS1-64, VLP-32C), HeLiPR
(Aeva, Avia) and simulated drives; comments give the values measured there.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from deepring.data.inspection.figures import FIELD, REACH, ScanFigures, measure_scan
from deepring.data.inspection.finding import Finding
from deepring.errors import BrokenScanError

#: Share of tiny and huge coordinates: 0 in every scan, 0.3 to 0.9 with wrong types.
MOST_ODD = 0.02
#: Difference of the distributions of x and z: 0.20 to 0.98; 0.00 to 0.03 where x, y and z come from
#: every column in turn.
LEAST_MIXED, LEAST_MIXED_POINTS = 0.06, 500
#: Difference of every other record: up to 0.05; 0.4 or more where every other one is no point.
MOST_ALTERNATING, LEAST_ALTERNATING_POINTS = 0.3, 500
#: Metres from the sensor to half of the points: 4 to 52. In a corridor 1.2. Less than 0.8 is no
#: surroundings, but coordinates scaled to 1; more than 150 is another unit or another origin.
NEAREST, FAR, FARTHEST = 0.8, 100.0, 150.0
#: Share within 80 m: 0.86 to 1.00. An image of less shows little.
LEAST_FIELD, UNUSABLE_FIELD = 0.5, 0.1
#: Share beyond 250 m: up to 0.002.
MOST_BEYOND = 0.1
#: Metres between the lowest and highest 5 %: 2 to 14. Houses are 100 m high in a few cities, and
#: where there is less than 0.4 m hardly anything stands out of the ground (0.5 on an open field).
LOWEST, TALLEST = 0.4, 120.0
#: Metres. Any bytes read as NCLT's fixed-point numbers, from -100 to 227 m, fill 300 m of height.
HIGHEST = 1000.0
#: Extent of z against the smaller one of x and y: up to 0.4, about 1 in a corridor. Where z extends
#: over more metres than `UPRIGHT_FROM` and is several times the other, it is not up.
UPRIGHT, UPRIGHT_FROM = 2.0, 10.0
#: Metres. A scan with less extent has no height, or no length.
FLAT = 0.05
#: Share of whole numbers among the values of z: up to 0.01.
MOST_WHOLE = 0.9
#: Share of the surroundings that agree on the ground: 0.55 to 0.98 in scans that show it, as low as
#: 0.2 under a strong tilt, where nothing is said of it.
LEAST_GROUND = 0.5
#: Metres between the ground that the points show and where it should be: up to 0.4 as a median of
#: several scans. Single scans tilt.
MOST_GROUND_OFF, MOST_GROUND_OFF_SINGLE = 0.75, 1.2
#: Metres above the ground, from which the surroundings that are looked at show little of it, but
#: some points are nearer to it than to the sensor.
HIGHEST_SENSOR = 10.0
#: Metres and ratio: points lie below the ground, and several times as deep as others are high.
DEEPEST, DEEPER = 3.0, 2.0
#: Points, below which no image can be recognised: 4000 to 130 000.
FEWEST_POINTS = 100
#: Share of records without a return: up to 0.47.
MOST_MISSING = 0.98

_TYPES = (
    "check the format: the type, byte order and number of the values of a point are not those of "
    "these files"
)


def scan_findings(
    points: NDArray[np.floating], ground_z: float | None, single: bool = True
) -> list[Finding]:
    """Doubts about the points (n, 3) of one scan, metres, missing returns included or not.

    ``ground_z`` is where the ground should be, None if not known.
    """
    return figure_findings(measure_scan(points), ground_z, single)


def expect_coordinates(points: NDArray[np.floating]) -> None:
    """Raise BrokenScanError for points (n, 3) that are no coordinates in any unit and frame.

    Whether they are metres from the sensor is told by what stands out of the ground.
    """
    figures = measure_scan(points)
    finding = _values(figures) or _records(figures) or _scattered(figures)
    if finding is None and _unit(figures) is None:
        finding = _whole(figures)
    if finding is not None:
        raise BrokenScanError(f"scan: {finding.found}; {finding.advice}")


def figure_findings(
    figures: ScanFigures, ground_z: float | None, single: bool = False
) -> list[Finding]:
    """Doubts about the figures of one scan (``single``), or the medians of several.

    A wrong type or unit makes everything else wrong too, so only the first of these is named.
    """
    for check in (_values, _records, _scattered, _unit, _whole, _flat):
        if (finding := check(figures)) is not None:
            return [finding]
    checks: tuple[Callable[[], Finding | None], ...] = (
        lambda: _extent(figures),
        lambda: _missing(figures),
        lambda: ground_finding(figures, ground_z, single),
    )
    return [finding for check in checks if (finding := check()) is not None]


def shows_ground(figures: ScanFigures) -> bool:
    """Whether the surroundings agree on where the ground is."""
    return figures.ground_share >= LEAST_GROUND


def _values(f: ScanFigures) -> Finding | None:
    if f.odd <= MOST_ODD:  # also without any point
        return None
    found = (
        f"{f.odd:.0%} of the coordinates are not plausible in any unit (smaller than 1e-20 or "
        "larger than 1e8), expected metres"
    )
    return Finding("scans", found, _TYPES, unusable=True)


def _records(f: ScanFigures) -> Finding | None:
    if f.points >= LEAST_MIXED_POINTS and f.mixed < LEAST_MIXED:
        found = (
            "x and z have the same distribution, as where values of all columns take turns "
            f"(difference {f.mixed:.2f}, expected at least 0.2)"
        )
        return Finding("scans", found, _TYPES, unusable=True)
    if f.points >= LEAST_ALTERNATING_POINTS and f.alternating > MOST_ALTERNATING:
        found = (
            "every other record differs from those between, as where a point has twice as many "
            f"values (difference {f.alternating:.2f}, expected about 0)"
        )
        return Finding("scans", found, _TYPES, unusable=True)
    return None


def _scattered(f: ScanFigures) -> Finding | None:
    """As high as wide and far off: other numbers, read as fixed-point metres of a fixed range."""
    if TALLEST < f.span_z < HIGHEST and f.span_z > min(f.span_x, f.span_y) / 2 and f.distance > FAR:
        found = (
            f"points fill {f.span_x:.0f} m x {f.span_y:.0f} m x {f.span_z:.0f} m, half of them "
            f"more than {f.distance:.0f} m away, expected surroundings that are wider than high"
        )
        return Finding("scans", found, _TYPES, unusable=True)
    return None


def _unit(f: ScanFigures) -> Finding | None:
    if f.distance > FARTHEST or f.field < UNUSABLE_FIELD:
        far = np.hypot(f.centre_x, f.centre_y) > f.distance / 2
        return Finding(
            "scans",
            f"half of the points are more than {f.distance:.4g} m from the origin and "
            f"{f.field:.0%} within {FIELD:.0f} m, expected most",
            "give points in the sensor's frame, instead of a map's, and in metres"
            if far
            else "give points in metres: millimetres and centimetres look like this",
            unusable=True,
        )
    if f.distance < NEAREST:
        return Finding(
            "scans",
            f"half of the points are within {f.distance:.3g} m of the sensor, expected metres to "
            "tens of metres",
            "give points in metres: kilometres, and coordinates scaled to 1, look like this",
            unusable=True,
        )
    return None


def _whole(f: ScanFigures) -> Finding | None:
    if not f.whole > MOST_WHOLE:
        return None
    found = f"{f.whole:.0%} of the z values are whole numbers, expected metres with fractions"
    advice = "check the order of the columns: x, y and z first, the intensity after them"
    return Finding("scans", found, advice, unusable=True)


def _flat(f: ScanFigures) -> Finding | None:
    spans = {"x": f.span_x, "y": f.span_y, "z": f.span_z}
    flat = [name for name, span in spans.items() if span < FLAT]
    if not flat:
        return None
    found = (
        f"{' and '.join(flat)} of nearly all points are the same (within {FLAT:g} m), expected "
        "surroundings in space"
    )
    advice = "check the format and the columns; a LiDAR with a single plane cannot be used"
    return Finding("scans", found, advice, unusable=True)


def _extent(f: ScanFigures) -> Finding | None:
    if f.points < FEWEST_POINTS:
        found = f"a scan has {f.points:.0f} points, expected thousands"
        return Finding("scans", found, "check the files: hardly anything can be recognised in them")
    advice = "check that points are in metres, in the sensor's frame, and z is up"
    if f.span_z > TALLEST:
        found = f"points spread over {f.span_z:.0f} m of height, expected up to {TALLEST:.0f} m"
        return Finding("scans", found, advice)
    narrow = min(f.span_x, f.span_y)
    if f.span_z > max(UPRIGHT_FROM, UPRIGHT * narrow):
        found = f"points spread over {f.span_z:.0f} m in z, but over {narrow:.0f} m in x or y"
        return Finding("scans", found, advice)
    if f.span_z < LOWEST:
        found = f"points spread over {f.span_z:.2f} m of height, expected metres"
        columns = "check the order of the columns (x, y, z first) and the surroundings"
        return Finding("scans", found, columns)
    if f.field < LEAST_FIELD or f.distance > FAR:
        found = f"{f.field:.0%} of the points are within {FIELD:.0f} m, expected most"
        return Finding("scans", found, advice)
    if f.beyond > MOST_BEYOND:
        found = f"{f.beyond:.0%} of the points are beyond {REACH:.0f} m, expected nearly none"
        return Finding("scans", found, advice)
    return None


def _missing(f: ScanFigures) -> Finding | None:
    if not f.missing > MOST_MISSING:
        return None
    found = f"{f.missing:.1%} of the records are missing returns, (0, 0, 0) or not finite"
    return Finding("scans", found, "check the format; a LiDAR outdoors misses up to half")


def ground_finding(f: ScanFigures, ground_z: float | None, single: bool = False) -> Finding | None:
    """A ground elsewhere than where it should be, or points below it."""
    if ground_z is None:
        return None
    most = MOST_GROUND_OFF_SINGLE if single else MOST_GROUND_OFF
    in_view = -ground_z < HIGHEST_SENSOR or f.low > ground_z / 2
    if in_view and shows_ground(f) and abs(f.ground - ground_z) > most:
        return Finding(
            "ground",
            f"the points show it at z = {f.ground:.2f} m, but it should be at {ground_z:.2f} m",
            "set the height of the sensor above the ground: ground_z, or sensor_height of a custom "
            "drive",
        )
    depth, height = ground_z - f.low, f.high - ground_z
    if depth > DEEPEST and depth > DEEPER * height:
        return Finding(
            "ground",
            f"points reach {depth:.1f} m below it and {height:.1f} m above it, with the ground at "
            f"z = {ground_z:.2f} m",
            "check that z is up, and the height of the sensor above the ground (ground_z, or "
            "sensor_height of a custom drive)",
        )
    return None
