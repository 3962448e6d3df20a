"""Marks on a map, whose kinds differ in shape and colour, and what they mean."""

from collections.abc import Iterable

from deepring.reports.escaping import escaped
from deepring.reports.svg import Point, dots

#: The path of a mark from its middle, by kind; `page.css` has their colours.
SHAPES = {
    "right": "h0",  # a line without length, whose ends are round
    "wrong": "m-2.4-2.4l4.8 4.8m0-4.8l-4.8 4.8",
    "none": "m-2 0a2 2 0 1 0 4 0a2 2 0 1 0-4 0",
    "fit": "m0-3.4l3.1 5.4h-6.2z",
    "ratio": "m-2.4-2.4h4.8v4.8h-4.8z",
    "few": "m0 3.4l3.1-5.4h-6.2z",
    "other": "m-3.2 0l3.2-3.2 3.2 3.2-3.2 3.2z",
    "lost": "m-3.2 0l3.2-3.2 3.2 3.2-3.2 3.2z",
    "start": "h0",
}


def mark(at: Point, kind: str) -> str:
    """One mark in a view box."""
    return marks([at], kind)


def marks(points: Iterable[Point], kind: str) -> str:
    """All marks of a kind in a view box as one element; equal points are drawn once."""
    data = "".join(f"M{x:g} {y:g}{SHAPES[kind]}" for x, y in dict.fromkeys(points))
    return f'<path class="hit {kind}" d="{data}"/>' if data else ""


def mark_legend(kind: str, words: str) -> tuple[str, str]:
    """An entry of a `legend`: a mark of a kind, or a place."""
    drawn = mark((5, 5), kind) if kind in SHAPES else dots([(5, 5)], kind)
    return f'<svg class="map" viewBox="0 0 10 10" aria-hidden="true">{drawn}</svg>', words


def line_legend(kind: str, words: str) -> tuple[str, str]:
    """An entry of a `legend`: a line."""
    line = f'<path class="line {kind}" d="M0 5H26"/>'
    return f'<svg viewBox="0 0 26 10" aria-hidden="true">{line}</svg>', words


def bar_legend(kind: str, words: str) -> tuple[str, str]:
    """An entry of a `legend`: an area."""
    area = f'<path class="bar {kind}" d="M0 0H26V10H0Z"/>'
    return f'<svg viewBox="0 0 26 10" aria-hidden="true">{area}</svg>', words


def legend(entries: Iterable[tuple[str, str]]) -> str:
    """What marks and lines mean: each as it is drawn, and its words."""
    items = "".join(f"<li>{drawn}{escaped(words)}</li>" for drawn, words in entries)
    return f'<ul class="legend">{items}</ul>'
