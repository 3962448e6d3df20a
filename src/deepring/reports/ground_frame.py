"""The ground from above as SVG: metres to a view box, with ticks."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from deepring.reports import svg
from deepring.reports.escaping import escaped
from deepring.reports.round_origin import axis_label, round_origin

#: Width of the view box, and room in it for ticks and labels.
WIDTH = 460
_LEFT, _RIGHT, _TOP, _BOTTOM = 48.0, 12.0, 12.0, 40.0

#: The height of the drawing as a share of its width, at least and at most.
_FLAT, _TALL = 0.35, 1.1

#: Ticks along the longer side, at most, and where there are no labels of the axes.
_TICKS, _FEW = 8, 5


class Frame:
    """From metres to the view box, the same scale along both axes."""

    def __init__(self, positions: NDArray[np.float64]) -> None:
        low, high = positions.min(axis=0), positions.max(axis=0)
        size = np.maximum(high - low, 1.0)
        across, up = size + 0.06 * size.max()
        room = WIDTH - _LEFT - _RIGHT
        tall = room * float(np.clip(up / across, _FLAT, _TALL))
        self.scale = float(min(room / across, tall / up))
        self.height = tall + _TOP + _BOTTOM
        self.origin = round_origin(positions)
        middle = (low + high) / 2
        half = np.array([room, tall]) / (2 * self.scale)
        self.low, self.high = middle - half, middle + half
        self._x = _LEFT + room / 2 - self.scale * middle[0]
        self._y = _TOP + tall / 2 + self.scale * middle[1]

    def at(self, position: Sequence[float] | NDArray[np.float64]) -> svg.Point:
        """The place of a position (2,) in the view box."""
        return (
            round(float(self._x + self.scale * position[0]), 1),
            round(float(self._y - self.scale * position[1]), 1),
        )

    def lines(self, strips: Iterable[Iterable[NDArray[np.float64]]], kind: str) -> str:
        """A line through each of the strips of positions (n, 2), all as one element."""
        data = "".join(svg.path(map(self.at, strip)) for strip in strips)
        return f'<path class="line {kind}" d="{data}"/>' if data else ""

    def drawn(
        self, parts: Sequence[str], axes: tuple[str, str] | None, described: str, kind: str
    ) -> str:
        """The map as one element; without ``axes`` it has no labels."""
        inside = "".join([*self._ticks(axes), *parts])
        return (
            f'<svg class="{kind}" viewBox="0 0 {WIDTH:g} {self.height:g}" role="group" '
            f'aria-label="{escaped(described)}">{inside}</svg>'
        )

    def _ticks(self, axes: tuple[str, str] | None) -> Iterator[str]:
        bottom = self.height - _BOTTOM
        most = _TICKS if axes else _FEW
        for tick in self._round(0, most):
            x, _ = self.at((tick, self.low[1]))
            yield f'<path class="grid" d="M{x} {_TOP:g}V{bottom:g}"/>'
            yield svg.text(x, bottom + 13, f"{tick - self.origin[0]:g}", "tick middle")
        for tick in self._round(1, most):
            _, y = self.at((self.low[0], tick))
            yield f'<path class="grid" d="M{_LEFT:g} {y}H{WIDTH - _RIGHT:g}"/>'
            yield svg.text(_LEFT - 5, y + 4, f"{tick - self.origin[1]:g}", "tick end")
        if axes is None:
            return
        x_label, y_label = (axis_label(*pair) for pair in zip(axes, self.origin, strict=True))
        middle = (_LEFT + WIDTH - _RIGHT) / 2
        yield svg.text(middle, self.height - 8, x_label, "label middle")
        turned = f"translate(11 {(_TOP + bottom) / 2:g}) rotate(-90)"
        yield f'<g transform="{turned}">{svg.text(0, 0, y_label, "label middle")}</g>'

    def _round(self, axis: int, most: int) -> list[float]:
        """Round numbers along an axis, as far apart as those of the other one."""
        sides = self.high - self.low
        low, high = (float(end[axis] - self.origin[axis]) for end in (self.low, self.high))
        ticks = svg.round_ticks(low, high, 1 + (most - 1) * float(sides[axis] / sides.max()))
        return [tick + float(self.origin[axis]) for tick in ticks]
