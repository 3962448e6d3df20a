"""Locating a scan in a map and closing loops, and the same with every candidate aligned at the full
resolution in plain torch, as it was before."""

import math
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from unittest import mock

import numpy as np
import torch
from scenes import moved, outline
from timing import Row, timed

from deepring.core.rigid import pose_from
from deepring.localization import map as maps
from deepring.localization.alignment import Alignment, align, image_correlation
from deepring.localization.alignment.image_correlation import half_whitened, occupied_cells
from deepring.localization.candidate_search import search_candidates
from deepring.localization.candidates import RerankSettings, align_candidates
from deepring.localization.map import Map
from deepring.localization.observation import Observation, described
from deepring.methods.network_file import load_network
from deepring.rasters.bev import bev_occupancy

POINTS, KEYFRAMES = 70_000, 1_000

LOCATED = f"a scan of {POINTS:,} points located in a map"
LOOP = "a keyframe described, looked up among the past, and added"
ALIGNED = "25 candidates aligned"
BEFORE = "before: {}, all at the full resolution in plain torch"

#: Milliseconds that each may take.
TARGETS = {LOCATED: 15.0, LOOP: 20.0, ALIGNED: 10.0}


def all_at_full_resolution(
    image: torch.Tensor,
    turn: torch.Tensor,
    places: torch.Tensor,
    settings: RerankSettings,
    _: torch.Tensor | None = None,
) -> Alignment:
    """Every candidate and both turns at the full resolution."""
    both = torch.stack([turn, turn + math.pi], dim=1)
    cells = occupied_cells(image, settings.alignment)
    return align(cells, half_whitened(places, settings.alignment), both, settings.alignment)


@contextmanager
def as_before() -> Iterator[None]:
    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(image_correlation, "_compiled", return_value=False))
        stack.enter_context(mock.patch.object(maps, "align_candidates", all_at_full_resolution))
        yield


def locate_stages(runs: int, places: int) -> Iterator[Row]:
    """In a map of so many places, a place every 20 m; a loop's keyframes are 2 m apart."""
    network, rng = load_network("shipped").method, np.random.default_rng(0)
    outlines = [outline(rng) for _ in range(places)]
    parts = [
        described(network, np.stack([bev_occupancy(one) for one in outlines[k : k + 64]]))
        for k in range(0, places, 64)
    ]
    seen = Observation(
        np.concatenate([part.images for part in parts]),
        torch.cat([part.descriptors for part in parts]),
    )
    campus = _map(network, seen, 20.0, columns=math.isqrt(places))
    scans = [_scan(outlines[k], rng) for k in range(0, places, max(1, places // 20))]
    yield from _both(LOCATED, places, scans, campus.localize, runs, "scan")

    past = min(KEYFRAMES, places)
    drive = _map(network, Observation(*(part[:past] for part in seen)), 2.0, columns=past)

    first = Observation(*(part[:1] for part in seen))
    drive.add_observation(first, np.eye(4)[None], ["one more"])  # makes room for others
    start = drive.places.mark(), drive.index.mark()

    def keyframe(points: np.ndarray) -> None:
        one = drive.observe([points])
        drive.localize_observation(one, before=past - 25)
        drive.add_observation(one, np.eye(4)[None], ["further"])
        drive.places.rewind(start[0])
        drive.index.rewind(start[1])

    yield from _both(LOOP, past, scans, keyframe, runs, "keyframe")
    found = [_candidates(campus, points) for points in scans]

    def aligned(one: tuple) -> None:
        # Looked up by name, so that `as_before` replaces it.
        maps.align_candidates(*one[:3], campus.rerank, one[3])

    assert maps.align_candidates is align_candidates
    yield from _both(ALIGNED, places, found, aligned, runs, "query")


def targets(rows: list[Row]) -> list[str]:
    """What was asked for, and how many times as long it took before, in this run."""
    lines, by_name = [], {row.what: row for row in rows}
    for what, most in TARGETS.items():
        if what in by_name:
            now, before = by_name[what], by_name[BEFORE.format(what)]
            reached = "reached" if now.median * 1e3 <= most else "MISSED"
            lines.append(
                f"- {what}: {now.median * 1e3:.1f} ms ({now.note}), asked for at most {most:g} ms: "
                f"{reached}; before {before.median * 1e3:.1f} ms ({before.note}), "
                f"{before.median / now.median:.1f} times as long"
            )
    return lines


def _both(what: str, n: int, items: list, function, runs: int, per: str) -> Iterator[Row]:
    """Rows of a function of each item, now and as before.

    The note is the processor's time, which other programs lengthen less than the clock's.
    """

    def over_all() -> None:
        for item in items:
            function(item)

    def row(what: str, runs: int) -> Row:
        over_all()
        started = time.process_time()
        seconds = timed(over_all, runs, len(items), 0)
        busy = (time.process_time() - started) / runs / len(items)
        return Row("locate", what, n, *seconds, per, f"processor {busy * 1e3:.1f} ms")

    yield row(what, max(3, runs // 3))
    with as_before():
        yield row(BEFORE.format(what), 3)


def _map(network, seen: Observation, spacing: float, columns: int) -> Map:
    built, k = Map(network), np.arange(len(seen.images))
    positions = np.column_stack([k % columns, k // columns, 0 * k]) * spacing
    poses = pose_from(np.broadcast_to(np.eye(3), (len(k), 3, 3)), positions)
    for first in range(0, len(k), 64):
        part = slice(first, first + 64)
        built.add_observation(
            Observation(*(v[part] for v in seen)), poses[part], [str(i) for i in k[part]]
        )
    return built


def _scan(one: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The place seen again, turned and some 3 m away, among points of the ground."""
    points = moved(one, rng.uniform(0, 2 * np.pi), rng.normal(0, 3, 2))
    points[:, 2] = rng.uniform(1, 5, len(points))
    rest = POINTS - len(points)
    ground = np.column_stack([rng.normal(0, 20, (rest, 2)), rng.normal(0, 0.03, rest)])
    return np.concatenate([points, ground]).astype(np.float32)


def _candidates(campus: Map, points: np.ndarray) -> tuple:
    """What `align_candidates` is given for a scan: image, turns, images of places, poses."""
    one = campus.observe([points])
    places, poses, turns, _ = search_candidates(
        campus.index, campus.places, one.descriptors, campus.rerank
    )
    images = campus.places.images(places)
    return torch.from_numpy(one.images[0]), turns, images, poses
