"""Whether the scans of a session are plausible: most, single ones, and where they are."""

import filecmp
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.data.inspection.figures import ScanFigures, measure_scan, median_figures
from deepring.data.inspection.finding import Finding
from deepring.data.inspection.readings import (
    UNITS,
    Reading,
    intensity_first,
    most_plausible,
    other_axes,
    other_record,
    other_unit,
)
from deepring.data.inspection.scans import figure_findings, shows_ground
from deepring.data.readers import binary_formats
from deepring.data.readers.custom.custom_scans import UP, CustomScans
from deepring.data.session import Session
from deepring.data.spacing import sample_of
from deepring.errors import DeepringError

#: Scans with which other readings are tried.
_TRIED = 3
#: Share of the scans that show the ground, from which their median is taken for the drive's.
LEAST_SHOWING = 0.25
#: Share of the median number of points, below and above which a scan is not like the others.
FEW_POINTS, MANY_POINTS = 0.2, 4.0
#: Metres that positions vary, from which it can be seen whether the points move along.
LEAST_MOTION = 20.0
#: Share of equal neighbours, from which scans cannot be used.
UNUSABLE_REPEATED = 0.5
#: Extent of z against that of x and y: up to 0.4. With more, other axes are tried.
UPRIGHT = 0.5
#: Share of the height of the sensor by which the ground may differ, if all is in feet.
NEAR = 0.15
#: Metres by which the lowest 5 % of the points may lie above the ground.
ABOVE_GROUND = 0.5


def measure_scans(session: Session, indices: Iterable[int]) -> dict[int, ScanFigures]:
    """Figures of the scans with these indices that can be read, before any crop of the session."""
    measured = {}
    for index in indices:
        try:
            measured[index] = measure_scan(records_of(session, index))
        except DeepringError:  # told by those who need the scan
            continue
    return measured


def crops(session: Session) -> bool:
    """Whether the session leaves out points by their position."""
    read = session.read
    return isinstance(read, CustomScans) and read != _uncropped(read)


def records_of(session: Session, index: int) -> NDArray[np.floating]:
    """Records (n, 3) of a scan, missing returns included, before any crop of the session.

    Raises BrokenScanError for a file that cannot be decoded.
    """
    read = session.read
    if isinstance(read, CustomScans):
        read = _uncropped(read)
    return read(session.files[index])


def _uncropped(read: CustomScans) -> CustomScans:
    return replace(read, z_band=None, azimuth=None, range=None)


def measured_findings(
    session: Session, measured: Mapping[int, ScanFigures], ground_z: float | None
) -> list[Finding]:
    """Doubts about scans by their figures: common to most, of single ones, and in the world."""
    figures = {index: one for index, one in measured.items() if one.points}
    if not figures:
        return []
    usual = usual_figures(list(figures.values()))
    common = figure_findings(usual, ground_z)
    tried = [list(figures)[k] for k in sample_of(len(figures), _TRIED)]
    if ground_z is not None:
        common = _explained(session, common, usual, ground_z, tried)
    if any(finding.unusable for finding in common):
        return common
    if in_world := _in_world(session, figures):
        return in_world
    return [*common, *_odd_ones(session, figures), *_counts(session, figures, usual)]


def usual_figures(figures: Sequence[ScanFigures]) -> ScanFigures:
    """Medians over scans, at least one; of the ground over those that show it, if enough do."""
    usual = median_figures(figures)
    showing = [one for one in figures if shows_ground(one)]
    if len(showing) < max(1, LEAST_SHOWING * len(figures)):
        return replace(usual, ground=np.nan, ground_share=0.0)
    ground = median_figures(showing)
    return replace(usual, ground=ground.ground, ground_share=ground.ground_share)


def _explained(
    session: Session,
    findings: list[Finding],
    usual: ScanFigures,
    ground_z: float,
    tried: list[int],
) -> list[Finding]:
    """The findings, with the other reading of the scans with which they would be plausible."""
    doubtful = [finding for finding in findings if finding.subject in ("scans", "ground")]
    tilted = usual.span_z > UPRIGHT * min(usual.span_x, usual.span_y)
    floating = usual.low > ground_z + ABOVE_GROUND
    if not (doubtful or tilted or floating):
        return findings
    scans = [records_of(session, k) for k in tried]
    with np.errstate(invalid="ignore", over="ignore"):
        reading = _intensity_first(session, tried, ground_z)
    if reading is None and any(finding.unusable for finding in doubtful):
        reading = _other_record(session, tried, ground_z)
    with np.errstate(invalid="ignore", over="ignore"):
        reading = reading or other_axes(scans, ground_z)
        if reading is None and any(finding.subject == "scans" for finding in doubtful):
            reading = other_unit(scans, ground_z) or _in_sensor_frame(
                session, scans, tried, ground_z
            )
        if reading is None and abs(usual.ground * UNITS["feet"] - ground_z) < NEAR * -ground_z:
            reading = other_unit(scans, ground_z, {"feet": UNITS["feet"]})
    if reading is None:
        return findings
    advice = f"read as {reading.name} they are plausible: {reading.advice}"
    if doubtful:
        first = doubtful[0]
        explained = replace(first, advice=advice, unusable=True)
        return [explained, *(finding for finding in findings if finding is not first)]
    found = (
        f"points spread over {usual.span_x:.0f} m in x, {usual.span_y:.0f} m in y and "
        f"{usual.span_z:.0f} m in z, without a ground at z = {ground_z:.2f} m"
    )
    return [Finding("scans", found, advice, unusable=True), *findings]


def _other_record(session: Session, tried: list[int], ground_z: float) -> Reading | None:
    read = session.read
    format, turn = None, np.eye(3)
    if isinstance(read, CustomScans):
        format, turn = read.format, UP[read.up].T
    else:
        names = (name for name, scans in binary_formats().items() if scans.read == read)
        format = next(names, None)
    files = [file for k in tried if (file := Path(session.files[k])).suffix == ".bin"]
    if format is None or not files:
        return None
    return other_record(files, format, ground_z, turn)


def _intensity_first(session: Session, tried: list[int], ground_z: float) -> Reading | None:
    turn = UP[session.read.up].T if isinstance(session.read, CustomScans) else np.eye(3)
    return intensity_first([Path(session.files[k]) for k in tried], ground_z, turn)


def _in_sensor_frame(
    session: Session, scans: list[NDArray[np.floating]], tried: list[int], ground_z: float
) -> Reading | None:
    """Points in the world, if they are plausible once they are moved back by the poses."""
    moved = []
    for k, points in zip(tried, scans, strict=False):
        pose = session.poses[k]
        moved.append((points - pose[:3, 3]) @ pose[:3, :3])
    if not moved or not most_plausible(moved, ground_z):
        return None
    return Reading("points in the poses' world", "move each scan back by its pose (inverse pose)")


def _odd_ones(session: Session, figures: Mapping[int, ScanFigures]) -> list[Finding]:
    """Scans that are unusable by themselves, although the others are not."""
    bad = {}
    for index, one in figures.items():
        for finding in figure_findings(one, None, single=True):
            if finding.unusable:
                bad[index] = finding
    if not bad:
        return []
    index, first = next(iter(bad.items()))
    found = (
        f"{len(bad)} of {len(figures)} differ from the others, the first {session.files[index]}: "
        f"{first.found}"
    )
    return [Finding("scans", found, "fetch or write them again, or remove them")]


def _counts(
    session: Session, figures: Mapping[int, ScanFigures], usual: ScanFigures
) -> list[Finding]:
    """Scans with far fewer or far more points than the median."""
    odd = [
        index
        for index, one in figures.items()
        if not FEW_POINTS * usual.points <= one.points <= MANY_POINTS * usual.points
    ]
    if not odd:
        return []
    found = (
        f"{len(odd)} of {len(figures)} have less than a fifth or more than four times the usual "
        f"{usual.points:.0f} points, the first {session.files[odd[0]]} with "
        f"{figures[odd[0]].points:.0f}"
    )
    return [Finding("scans", found, "check whether these files were cut or merged")]


def _in_world(session: Session, figures: Mapping[int, ScanFigures]) -> list[Finding]:
    """Points that move with the poses, as those of a map do, instead of with the sensor."""
    centres = np.array([[one.centre_x, one.centre_y] for one in figures.values()])
    positions = session.positions[list(figures)]

    def spread(values: NDArray[np.float64]) -> float:
        return float(np.median(np.linalg.norm(values - np.median(values, axis=0), axis=1)))

    motion, moving = spread(positions), spread(centres)
    if motion < LEAST_MOTION or spread(centres - positions) > moving / 3:
        return []
    found = (
        f"the points move with the poses, by {moving:.0f} m against {motion:.0f} m, expected "
        "points around the sensor"
    )
    advice = "give points in the sensor's frame: move each scan back by its pose (inverse pose)"
    return [Finding("scans", found, advice, unusable=True)]


def repeated_findings(session: Session, indices: Sequence[int]) -> list[Finding]:
    """Scans among those with these indices that are byte for byte the next one."""
    last = len(session) - 1
    pairs = [(k, k + 1) for k in indices if k < last]
    equal = [first for first, second in pairs if _same(session.files[first], session.files[second])]
    if not equal:
        return []
    share = len(equal) / len(pairs)
    found = (
        f"{len(equal)} of {len(pairs)} files are byte for byte the next one, the first "
        f"{session.files[equal[0]]}"
    )
    advice = "no LiDAR measures the same twice: check the recording, or remove repeated scans"
    return [Finding("scans", found, advice, unusable=share > UNUSABLE_REPEATED)]


def _same(one: Path, other: Path) -> bool:
    try:
        return filecmp.cmp(one, other, shallow=False)
    except (OSError, TypeError, ValueError):  # unreadable, or no files
        return False
