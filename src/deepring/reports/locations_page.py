"""Scans located in a map as one HTML page: where they are, how they fit, and how far off."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain, zip_longest
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from deepring.core.rigid import wrap_angle, yaw_of
from deepring.data.packed_rasters import unpack
from deepring.data.spacing import sample_of
from deepring.localization.calibration import (
    LocalizationTrials,
    Tolerance,
    trials_of,
)
from deepring.localization.map import Map
from deepring.reports.errors_plot import errors_plot
from deepring.reports.html import (
    bullets,
    figure,
    heading,
    long_table,
    page,
    paragraph,
    pictures_in_rows,
    table,
)
from deepring.reports.indexed_png import Colour
from deepring.reports.located_scan import LocatedScan, lie_in_place
from deepring.reports.places_drawing import Marked, places_drawing
from deepring.reports.scan_images import defined, overlaid, scan_image

#: Rows of the table, reasons of refusals, and alignments shown.
_LISTED, _REASONS, _SHOWN = 1000, 50, 8

#: What a doubt says, and its kind of mark.
_DOUBTS = {
    "fit": ("fits too little", "fit"),
    "ratio": ("fits elsewhere nearly as well", "ratio"),
    "few cells": ("shows too little", "few"),
}

#: The colours of a place, and of a scan by its kind of mark, which can be told from each other on
#: white and on dark paper.
_PLACE: Colour = (140, 140, 140)
_SCANS: dict[str, Colour] = {
    "right": (0, 158, 115),
    "wrong": (226, 98, 16),
    "fit": (215, 146, 0),
    "ratio": (201, 106, 160),
    "few": (36, 132, 208),
    "other": (140, 110, 90),
}

#: Trusted locations that lie further from the true poses than this, metres, in the middle, say that
#: the poses are of another world than the map's.
_ANOTHER_WORLD = 20.0


def locations_page(
    name: str, place_map: Map, scans: Sequence[LocatedScan], refused: Sequence[str] = ()
) -> str:
    """The page, which needs no network and no other file.

    Args:
        name: of the map's file.
        place_map: the map.
        scans: those that were located.
        refused: why the others were not.
    """
    truth = [scan for scan in scans if scan.pose is not None]
    trials = trials_of(
        place_map, [(one.location, one.pose) for one in truth if one.pose is not None]
    )
    right = dict(zip(map(id, truth), trials.correct(Tolerance()).tolist(), strict=True))
    wrong = {id(scan) for scan in truth if scan.location.trusted and not right[id(scan)]}
    parts = [table(("", ""), _summary(place_map, scans, refused, wrong if truth else None))]
    if len(place_map):
        drawing = _drawing(place_map, scans, wrong)
        parts.append(figure(drawing, "Located scans from above", "ground"))
    if refused:
        parts += [heading("Refused"), bullets(refused, _REASONS)]
    if truth:
        parts += _errors(trials, truth)
    if scans:
        parts += [heading("How scans lie on their places"), paragraph(_EXPLANATION)]
        parts.append(pictures_in_rows(_alignments(place_map, scans, wrong), "scans"))
        off = dict(
            zip(map(id, truth), zip(trials.metres, trials.degrees, strict=True), strict=True)
        )
        parts += [heading("Scans"), _table(scans, off)]
        if len(scans) > _LISTED:
            rest = f"And {len(scans) - _LISTED} more; --as csv or --as json has all of them."
            parts.append(paragraph(rest))
    return page(f"Scans in the map {name}", parts)


_EXPLANATION = (
    "Grey: what the place shows from above, its sensor in the middle, x forward, upwards. Coloured "
    "as on the map: what the scan shows, laid where it was located, and its sensor; green is "
    "trusted."
)


def _summary(
    place_map: Map, scans: Sequence[LocatedScan], refused: Sequence[str], wrong: set[int] | None
) -> Iterator[tuple[str, str]]:
    trusted = sum(scan.location.trusted for scan in scans)
    yield "places", str(len(place_map))
    yield "scans", str(len(scans) + len(refused))
    yield "trusted", str(trusted)
    if wrong is not None:
        yield "trusted wrongly", str(len(wrong))
    doubts = Counter(scan.location.doubt for scan in scans if scan.location.doubt is not None)
    for doubt, count in doubts.items():
        yield f"doubtful: {doubt}", f"{count}, {_doubt(doubt)[0]}"
    if refused:
        yield "refused", str(len(refused))
    thresholds = place_map.thresholds
    yield "trust", f"fit {thresholds.fit:g}, ratio {thresholds.ratio:g}"


def _doubt(doubt: str) -> tuple[str, str]:
    return _DOUBTS.get(doubt, (doubt, "other"))


def _drawing(place_map: Map, scans: Sequence[LocatedScan], wrong: set[int]) -> str:
    groups: dict[tuple[str, str], list[LocatedScan]] = {}
    for scan in scans:
        groups.setdefault(_kind(scan, wrong), []).append(scan)
    marked = [
        Marked(label, np.array([_found(scan) for scan in group]), kind)
        for (label, kind), group in sorted(groups.items())
    ]
    errors = [
        (_found(scan), scan.pose[:2, 3])
        for scan in scans
        if id(scan) in wrong and scan.pose is not None
    ]
    return places_drawing(place_map.places.positions, (), marked, errors)


def _kind(scan: LocatedScan, wrong: set[int]) -> tuple[str, str]:
    """Label and kind of mark."""
    if id(scan) in wrong:
        return "trusted, but wrong", "wrong"
    doubt = scan.location.doubt
    if doubt is None:
        return "trusted", "right"
    return f"doubtful: {doubt}", _doubt(doubt)[1]


def _found(scan: LocatedScan) -> NDArray[np.float64]:
    return np.array([scan.location.x, scan.location.y])


def _errors(trials: LocalizationTrials, truth: Sequence[LocatedScan]) -> Iterator[str]:
    """How far scans are off whose true poses are known."""
    tolerance = Tolerance()
    trusted = np.array([scan.location.trusted for scan in truth])
    correct = trials.correct(tolerance)
    near = trials.nearest <= tolerance.reach
    yield heading("Errors beside the true poses")
    if trusted.any() and np.median(trials.metres[trusted]) > _ANOTHER_WORLD:
        yield paragraph(
            "Mind: most trusted locations lie far from the drive's poses. These seem to be of "
            "another world than the map's, and then the errors say nothing."
        )
    yield figure(errors_plot(trials, trusted), "Errors of the located positions", "ground")
    right = f"within {tolerance.metres:g} m and {tolerance.degrees:g}°"
    head = ("", "scans", right, "median", "95 %", "largest", "median turn")
    kinds = (("all", trusted | True), ("trusted", trusted), ("doubtful", ~trusted))
    rows = [
        (name, *_spread(trials.metres[of], trials.degrees[of], tolerance)) for name, of in kinds
    ]
    refined = [
        _pose_errors(scan.refined, scan.pose)
        for scan in truth
        if scan.refined is not None and scan.pose is not None
    ]
    if refined:
        metres, degrees = np.array(refined).T
        rows.append(("refined", *_spread(metres, degrees, tolerance)))
    yield table(head, rows)
    both, reachable = int((trusted & correct & near).sum()), int(near.sum())
    yield paragraph(
        f"{both} of the {reachable} scans within {tolerance.reach:g} m of a place are trusted and "
        f"right; {int((trusted & ~correct).sum())} of {int(trusted.sum())} trusted ones are wrong."
    )


def _spread(
    metres: NDArray[np.float64], degrees: NDArray[np.float64], tolerance: Tolerance
) -> tuple[str, ...]:
    """How many there are, how many are right, and how far they are off."""
    right = (metres < tolerance.metres) & (degrees < tolerance.degrees)
    counts = (str(len(metres)), str(int(right.sum())))
    if not len(metres):
        return (*counts, "", "", "", "")
    sizes = (np.median(metres), np.percentile(metres, 95), metres.max())
    return (*counts, *(f"{size:.2f} m" for size in sizes), f"{np.median(degrees):.2f}°")


def _pose_errors(pose: NDArray[np.float64], true: NDArray[np.float64]) -> tuple[float, float]:
    """Metres along the ground and degrees of heading between a pose (4, 4) and the true one."""
    metres = np.hypot(*(pose[:2, 3] - true[:2, 3]))
    turn = wrap_angle(float(yaw_of(pose)) - float(yaw_of(true)))
    return float(metres), abs(math.degrees(turn))


def _alignments(place_map: Map, scans: Sequence[LocatedScan], wrong: set[int]) -> Iterator[str]:
    """Pictures of some scans of every kind, wrong ones first."""
    raster = place_map.raster
    shown = selection(scans, [_kind(scan, wrong) for scan in scans], _SHOWN)
    for number, scan in enumerate(shown):
        found = scan.location
        place = torch.tensor([found.place])
        (image,) = place_map.places.images(place).numpy()
        (pose,) = place_map.places.planar_poses(place).numpy()
        seen = unpack(scan.image[None], raster)[0].astype(np.bool_)
        label, kind = _kind(scan, wrong)
        words = (
            f"{scan.name} on {found.name}: {label}, fit {found.fit:.2f}, ratio {found.ratio:.2f}"
        )
        names = f"place-{number}", f"scan-{number}"
        images = defined(
            scan_image(name, each, raster.extent, colour)
            for name, each, colour in zip(
                names, (image.astype(np.bool_), seen), (_PLACE, _SCANS[kind]), strict=True
            )
        )
        drawing = overlaid(*names, lie_in_place(found, pose), raster.extent, words)
        yield figure(images + drawing, words)


def selection(scans: Sequence[LocatedScan], kinds: Sequence[Any], most: int) -> list[LocatedScan]:
    """At most so many scans, of each kind as many as of another, spread over the scans."""
    groups: dict[Any, list[LocatedScan]] = {}
    for scan, kind in zip(scans, kinds, strict=True):
        groups.setdefault(kind, []).append(scan)
    spread = [
        [group[row] for row in sample_of(len(group), most)]
        for _, group in sorted(groups.items(), reverse=True)
    ]
    turns = zip_longest(*spread)
    return [scan for scan in chain.from_iterable(turns) if scan is not None][:most]


def _answer(doubt: str | None) -> str:
    """Whether to trust a location, as `deepring localize` says it, and why not."""
    if doubt is None:
        return "yes"
    return f"{'no' if doubt in ('fit', 'ratio') else 'cannot tell'}: {doubt}"


def _table(scans: Sequence[LocatedScan], off: dict[int, tuple[float, float]]) -> str:
    head = ["scan", "x m", "y m", "yaw °", "fit", "ratio", "trusted"]
    head += ["off m", "off °"] if off else []
    head.append("found by")

    def cells(scan: LocatedScan) -> Iterator[str]:
        found = scan.location
        yield scan.name
        yield f"{found.x:.2f}"
        yield f"{found.y:.2f}"
        yield f"{math.degrees(found.yaw):.1f}"
        yield f"{found.fit:.2f}"
        yield f"{found.ratio:.2f}"
        yield _answer(found.doubt)
        if off:
            yield from (f"{value:.2f}" for value in off.get(id(scan), ()))
        yield found.name

    rows = (list(cells(scan)) for scan in scans[:_LISTED])
    return long_table(head, rows, ("trusted", "found by"))
