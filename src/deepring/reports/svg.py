"""Small line plots as SVG, whose colours are those of the page around them: light, dark or printed.

A plot has the size of its view box and is scaled to the room that it is given. Classes name what
things are; `deepring.reports.html` says how they look.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from deepring.reports.escaping import escaped

Point = tuple[float, float]

#: Size of a plot and the room for its labels, in units of the view box.
WIDTH, HEIGHT = 300, 212
_LEFT, _RIGHT, _TOP, _BOTTOM = 38, 10, 10, 38


@dataclass(frozen=True)
class Axis:
    """One axis of a plot: what is drawn along it, from where to where, and its ticks."""

    label: str
    low: float
    high: float
    ticks: Sequence[float]
    names: Sequence[str] = ()
    """Of the ticks; without them their numbers."""

    def share(self, value: float) -> float:
        """Where a value lies between the ends, in [0, 1]; what lies outside is drawn at the end."""
        return min(max((value - self.low) / (self.high - self.low), 0.0), 1.0)

    def name(self, number: int) -> str:
        """The text of a tick."""
        return self.names[number] if self.names else f"{self.ticks[number]:g}"


#: An axis of rates.
RATES = (0.0, 0.25, 0.5, 0.75, 1.0)


def rate_axis(label: str) -> Axis:
    """The whole range of a rate, so that plots compare."""
    return Axis(label, 0.0, 1.0, RATES)


@dataclass(frozen=True)
class Plot:
    """A plot's axes, by which its marks are placed."""

    across: Axis
    up: Axis
    width: int = WIDTH
    height: int = HEIGHT

    def at(self, x: float, y: float) -> Point:
        """The place of a value in the view box."""
        width, height = self.width - _LEFT - _RIGHT, self.height - _TOP - _BOTTOM
        return (
            round(_LEFT + width * self.across.share(x), 1),
            round(_TOP + height * (1 - self.up.share(y)), 1),
        )

    def drawn(self, marks: Iterable[str], described: str) -> str:
        """The plot with its marks, as one element; ``described`` is for those who do not see it."""
        return (
            f'<svg class="plot" viewBox="0 0 {self.width} {self.height}" role="img" '
            f'aria-label="{escaped(described)}">{self._frame()}{"".join(marks)}</svg>'
        )

    def _frame(self) -> str:
        left, bottom = self.at(self.across.low, self.up.low)
        right, top = self.at(self.across.high, self.up.high)
        parts = []
        for number, tick in enumerate(self.across.ticks):
            x, _ = self.at(tick, self.up.low)
            parts.append(f'<path class="grid" d="M{x} {top}V{bottom}"/>')
            parts.append(text(x, bottom + 13, self.across.name(number), "tick middle"))
        for number, tick in enumerate(self.up.ticks):
            _, y = self.at(self.across.low, tick)
            parts.append(f'<path class="grid" d="M{left} {y}H{right}"/>')
            parts.append(text(left - 5, y + 4, self.up.name(number), "tick end"))
        parts.append(f'<path class="axis" d="M{left} {top}V{bottom}H{right}"/>')
        parts.append(text((left + right) / 2, self.height - 8, self.across.label, "label middle"))
        turned = f"translate(10 {(top + bottom) / 2:g}) rotate(-90)"
        parts.append(f'<g transform="{turned}">{text(0, 0, self.up.label, "label middle")}</g>')
        return "".join(parts)

    def line(self, points: Iterable[Point], kind: str) -> str:
        """A line through the points."""
        return f'<path class="line {kind}" d="{path(self.at(*point) for point in points)}"/>'

    def band(self, low: Sequence[Point], high: Sequence[Point], kind: str) -> str:
        """The area between two lines."""
        around = path(self.at(*point) for point in [*low, *reversed(high)])
        return f'<path class="band {kind}" d="{around}Z"/>'

    def bar(self, across: Point, up: Point, kind: str, told: str) -> str:
        """The area from one value to another along both axes; ``told`` as of a `dot`."""
        (left, bottom), (right, top) = (self.at(*corner) for corner in zip(across, up, strict=True))
        title = f"<title>{escaped(told)}</title>"
        return f'<path class="bar {kind}" d="M{left} {bottom}H{right}V{top}H{left}Z">{title}</path>'

    def dot(self, x: float, y: float, kind: str, told: str = "") -> str:
        """A dot; ``told`` is said where the pointer rests on it."""
        return dot(*self.at(x, y), kind, told)


def dot(x: float, y: float, kind: str, told: str = "", size: float = 3.2) -> str:
    """A dot in a view box."""
    title = f"<title>{escaped(told)}</title>" if told else ""
    return f'<circle class="dot {kind}" cx="{x:g}" cy="{y:g}" r="{size:g}">{title}</circle>'


def text(x: float, y: float, words: str, kind: str = "") -> str:
    """Words in a view box."""
    return f'<text class="{kind}" x="{x:g}" y="{y:g}">{escaped(words)}</text>'


def path(points: Iterable[Point]) -> str:
    """The data of a path through places in a view box, repeated ones left out."""
    parts: list[str] = []
    before: Point | None = None
    for x, y in points:
        if (x, y) != before:
            parts.append(f"{'L' if parts else 'M'}{x:g} {y:g}")
        before = x, y
    return "".join(parts)


def dots(points: Iterable[Point], kind: str) -> str:
    """Many equal round marks as one path: lines without length, whose ends are round.

    Those at one point are drawn once.
    """
    data = "".join(f"M{x:g} {y:g}h0" for x, y in dict.fromkeys(points))
    return f'<path class="marks {kind}" d="{data}"/>' if data else ""


def round_ticks(low: float, high: float, most: float = 5) -> list[float]:
    """Up to ``most`` round numbers between two, evenly apart.

    >>> round_ticks(0, 20)
    [0.0, 5.0, 10.0, 15.0, 20.0]
    """
    if not high > low:
        return [low]
    raw = (high - low) / max(most - 1, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in (1, 2, 2.5, 5, 10) if power * factor >= raw * 0.999)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [number * step for number in range(first, last + 1)]
