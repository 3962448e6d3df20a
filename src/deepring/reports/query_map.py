"""Queries of a test from above: right, wrong, or without a place; one map for each method."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from deepring.reports import svg
from deepring.reports.escaping import escaped
from deepring.reports.query_view import QueryMap
from deepring.reports.round_origin import axis_label, round_origin

#: Width of the view box, and room for ticks and labels.
_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM = 460.0, 48.0, 12.0, 12.0, 40.0

#: The height of the drawing as a share of its width, at least and at most.
_FLAT, _TALL = 0.35, 1.1

KINDS = ("right", "wrong", "none")
NAMES = {
    "right": "right",
    "wrong": "wrong",
    "none": "without a place",
}


class Frame:
    """From metres to the view box, the same scale along both axes."""

    def __init__(self, positions: NDArray[np.float64]) -> None:
        low, high = positions.min(axis=0), positions.max(axis=0)
        size = np.maximum(high - low, 1.0)
        self.low, self.high = low - 0.03 * size.max(), high + 0.03 * size.max()
        across, up = self.high - self.low
        room = _WIDTH - _LEFT - _RIGHT
        tall = room * float(np.clip(up / across, _FLAT, _TALL))
        self.scale = float(min(room / across, tall / up))
        self.height = tall + _TOP + _BOTTOM
        self.origin = round_origin(positions)
        middle = (self.low + self.high) / 2
        self._x = _LEFT + room / 2 - self.scale * middle[0]
        self._y = _TOP + tall / 2 + self.scale * middle[1]

    def at(self, position: Sequence[float] | NDArray[np.float64]) -> svg.Point:
        """The place of a position (2,) in the view box."""
        return (
            round(float(self._x + self.scale * position[0]), 1),
            round(float(self._y - self.scale * position[1]), 1),
        )

    def drawn(
        self, parts: Sequence[str], axes: tuple[str, str] | None, described: str, kind: str
    ) -> str:
        """The map as one element; without ``axes`` it has no labels."""
        inside = "".join([*self._ticks(axes), *parts])
        return (
            f'<svg class="{kind}" viewBox="0 0 {_WIDTH:g} {self.height:g}" role="group" '
            f'aria-label="{escaped(described)}">{inside}</svg>'
        )

    def _ticks(self, axes: tuple[str, str] | None) -> Iterator[str]:
        bottom = self.height - _BOTTOM
        for tick in self._round(0):
            x, _ = self.at((tick, self.low[1]))
            yield f'<path class="grid" d="M{x} {_TOP:g}V{bottom:g}"/>'
            yield svg.text(x, bottom + 13, f"{tick - self.origin[0]:g}", "tick middle")
        for tick in self._round(1):
            _, y = self.at((self.low[0], tick))
            yield f'<path class="grid" d="M{_LEFT:g} {y}H{_WIDTH - _RIGHT:g}"/>'
            yield svg.text(_LEFT - 5, y + 4, f"{tick - self.origin[1]:g}", "tick end")
        if axes is None:
            return
        x_label, y_label = (axis_label(*pair) for pair in zip(axes, self.origin, strict=True))
        middle = (_LEFT + _WIDTH - _RIGHT) / 2
        yield svg.text(middle, self.height - 8, x_label, "label middle")
        turned = f"translate(11 {(_TOP + bottom) / 2:g}) rotate(-90)"
        yield f'<g transform="{turned}">{svg.text(0, 0, y_label, "label middle")}</g>'

    def _round(self, axis: int) -> list[float]:
        low, high = (float(end[axis] - self.origin[axis]) for end in (self.low, self.high))
        return [tick + float(self.origin[axis]) for tick in svg.round_ticks(low, high, 6)]


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
        parts.append(marks(frame, region.queries[kinds == kind], kind))
    counts = ", ".join(f"{(kinds == kind).sum()} {NAMES[kind]}" for kind in KINDS)
    drawing = frame.drawn(parts, None, f"{region.title}, {name}: {counts}", "small map")
    return f"<figure>{drawing}<figcaption><b>{escaped(name)}</b>: {counts}</figcaption></figure>"


def places(frame: Frame, region: QueryMap) -> str:
    """The places as faint marks."""
    return svg.dots(map(frame.at, region.places), "place")


def marks(frame: Frame, positions: NDArray[np.float64], kind: str) -> str:
    """Queries of one kind: dots, crosses where wrong, rings without a place."""
    data = "".join(shape(*frame.at(position), kind) for position in positions)
    return f'<path class="hit {kind}" d="{data}"/>' if data else ""


def shape(x: float, y: float, kind: str) -> str:
    """The path of one mark; kinds differ in more than colour."""
    if kind == "right":
        return f"M{x:g} {y:g}h0"
    if kind == "wrong":
        return f"M{x - 2.4:g} {y - 2.4:g}l4.8 4.8m0-4.8l-4.8 4.8"
    return f"M{x - 2:g} {y:g}a2 2 0 1 0 4 0a2 2 0 1 0-4 0"


def map_legend() -> str:
    """What the marks mean."""
    drawn = {"place": svg.dots([(5, 5)], "place")} | {
        kind: f'<path class="hit {kind}" d="{shape(5, 5, kind)}"/>' for kind in KINDS
    }
    items = "".join(
        f'<li><svg class="map" viewBox="0 0 10 10" aria-hidden="true">{mark}</svg>'
        f"{NAMES.get(kind, kind)}</li>"
        for kind, mark in drawn.items()
    )
    return f'<ul class="legend">{items}</ul>'
