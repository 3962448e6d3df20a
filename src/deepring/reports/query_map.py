"""Queries of a test from above: right, wrong, or without a place; one map for each method."""

import numpy as np
from numpy.typing import NDArray

from deepring.reports import svg
from deepring.reports.escaping import escaped
from deepring.reports.ground_frame import Frame
from deepring.reports.marks import legend, mark_legend, marks
from deepring.reports.query_view import QueryMap

KINDS = ("right", "wrong", "none")
NAMES = {
    "right": "right",
    "wrong": "wrong",
    "none": "without a place",
}


def kinds_of(
    metres: NDArray[np.float32], nearest: NDArray[np.float32], radius: float
) -> NDArray[np.str_]:
    """'right', 'wrong' or 'none' (q,): whether the place that was found lies within the radius."""
    answered = np.where(metres <= np.float32(radius), "right", "wrong")
    return np.where(nearest <= np.float32(radius), answered, "none")


def hit_maps(region: QueryMap) -> list[str]:
    """A map of each method, all over the same ground, of the queries that it was asked."""
    frame = Frame(np.concatenate([region.places, region.queries]))
    return [_hit_map(frame, region, name, metres) for name, metres in region.by_method.items()]


def _hit_map(frame: Frame, region: QueryMap, name: str, metres: NDArray[np.float32]) -> str:
    asked = np.isfinite(metres)
    kinds = np.where(asked, kinds_of(metres, region.nearest, region.radius), "")
    parts = [places(frame, region)]
    for kind in ("none", "right", "wrong"):  # the wrong ones on top
        parts.append(marks(map(frame.at, region.queries[kinds == kind]), kind))
    counts = ", ".join(f"{(kinds == kind).sum()} {NAMES[kind]}" for kind in KINDS)
    drawing = frame.drawn(parts, None, f"{region.title}, {name}: {counts}", "small map")
    return f"<figure>{drawing}<figcaption><b>{escaped(name)}</b>: {counts}</figcaption></figure>"


def places(frame: Frame, region: QueryMap) -> str:
    """The places as faint marks."""
    return svg.dots(map(frame.at, region.places), "place")


def map_legend() -> str:
    """What the marks mean."""
    return legend(mark_legend(kind, NAMES.get(kind, kind)) for kind in ("place", *KINDS))
