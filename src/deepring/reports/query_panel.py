"""One query of a test beside the place that was found and the nearest: scans, overlays, curves."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.reports import html, svg
from deepring.reports.escaping import escaped
from deepring.reports.lie import Lie
from deepring.reports.marks import legend, line_legend
from deepring.reports.query_map import NAMES, kinds_of
from deepring.reports.query_view import PlaceView, QueryMap, QueryView, ScanView
from deepring.reports.scan_images import laid_out, overlaid, value_image


class Names(NamedTuple):
    """The names of a region's elements on the page."""

    region: str

    def query(self, number: int) -> str:
        """Of the panel of a query, which is the end of a link to it."""
        return f"query-{self.region}-{number}"

    def query_scan(self, number: int) -> str:
        """Of the picture of a query."""
        return f"q-{self.region}-{number}"

    def place_scan(self, number: int) -> str:
        """Of the picture of a place."""
        return f"p-{self.region}-{number}"

    @property
    def map(self) -> str:
        """Of the map."""
        return f"map-{self.region}"


def query_panel(
    region: QueryMap, view: QueryView, names: Names, around: Sequence[QueryView], first: bool
) -> str:
    """The panel; ``around`` are the queries before and after it, as far as there are any."""
    kind = "pictures" if view.nearest is not None else "two pictures"
    parts = [
        f"<h4>{escaped(_said(region, view))}</h4>",
        _links(names, view, around),
        _verdicts(region, view.row),
        f'<div class="{kind}">\n{"".join(_pictures(region, view, names))}\n</div>',
    ]
    if (plot := _correlation(region, view)) is not None:
        parts.append(
            f'<figure class="correlation">{plot}<figcaption>The score over the turn of the points '
            "from place to query; lines are the true turns.</figcaption></figure>"
        )
    kind = "query first" if first else "query"
    name = names.query(view.scan.number)
    return f'<section class="{kind}" id="{name}">\n' + "\n".join(parts) + "\n</section>"


def _said(region: QueryMap, view: QueryView) -> str:
    kind = _kind(region, region.metres[view.row], view.row)
    score = "" if view.found.score is None else f", score {view.found.score:.3f}"
    nearest = "it is the nearest"
    if view.nearest is not None:
        nearest = f"the nearest, {view.nearest.scan.number}, lies {view.nearest.metres:.1f} m away"
    return (
        f"Query {view.scan.number}: {NAMES[kind]}. Place {view.found.scan.number} was found, "
        f"{view.found.metres:.1f} m away{score}; {nearest}."
    )


def _kind(region: QueryMap, metres: float, row: int) -> str:
    found = np.array([metres], dtype=np.float32)
    return str(kinds_of(found, region.nearest[row : row + 1], region.radius)[0])


def _links(names: Names, view: QueryView, around: Sequence[QueryView]) -> str:
    before = [each for each in around if each.row < view.row]
    after = [each for each in around if each.row > view.row]
    parts = [(f"#{names.map}", "map")]
    parts += [(f"#{names.query(each.scan.number)}", "← previous") for each in before]
    parts.append((f"#{names.query(view.scan.number)}", "link"))
    parts += [(f"#{names.query(each.scan.number)}", "next →") for each in after]
    links = " ".join(f'<a href="{to}">{word}</a>' for to, word in parts)
    return f'<p class="ways">{links}</p>'


def _verdicts(region: QueryMap, row: int) -> str:
    """What each method found for this query."""
    items = []
    for name, metres in region.by_method.items():
        value = float(metres[row])
        if math.isfinite(value):
            kind = _kind(region, value, row)
            words = f"{name}: {NAMES[kind] if kind != 'none' else ''} {value:.1f} m"
            items.append(f'<li class="{kind}">{escaped(" ".join(words.split()))}</li>')
    return f'<ul class="verdicts">{"".join(items)}</ul>'


def _pictures(region: QueryMap, view: QueryView, names: Names) -> Iterator[str]:
    """The scans, the overlays, and what the method makes of the scans, a row of each."""
    found, nearest = view.found, view.nearest
    places = [found] if nearest is None else [found, nearest]
    query = names.query_scan(view.scan.number)
    titles = [f"query {view.scan.number}"]
    titles += [f"found: place {found.scan.number}, {found.metres:.1f} m"]
    titles += [f"nearest: place {p.scan.number}, {p.metres:.1f} m" for p in places[1:]]
    scans = [query, *(names.place_scan(place.scan.number) for place in places)]
    for name, title in zip(scans, titles, strict=True):
        yield html.figure(laid_out(name, region.extent, f"{title}, from above"), title)
    yield from _overlays(region, places, query, names)
    views = [view.scan, *(place.scan for place in places)]
    yield from _values([each.sinogram for each in views], "sinogram (θ down, τ across)", titles)
    yield from _values([each.descriptor for each in views], "descriptor", titles)


def _overlays(
    region: QueryMap, places: Sequence[PlaceView], query: str, names: Names
) -> Iterator[str]:
    """The query on the place that was found, as it is told to lie, and on each as it truly does."""
    found = places[0]
    name = names.place_scan(found.scan.number)
    told = found.told
    if told is not None and told.position is not None:
        yield _overlay(region, name, query, told, "as the method tells")
    elif found.aligned is not None:
        by = "the images aligned" if told is None else "turned by the method, images aligned"
        lie = found.aligned
        yield _overlay(region, name, query, lie, f"{by}, fit {found.fit:.2f}")
    elif told is not None:
        yield _overlay(region, name, query, told, "turned by the method")
    for place in places:
        which = "true pose on the nearest" if place is not found else "true pose on the found"
        yield _overlay(region, names.place_scan(place.scan.number), query, place.true, which)


def _overlay(region: QueryMap, place: str, query: str, lie: Lie, words: str) -> str:
    pose = f"turn {math.degrees(lie.turn):z.0f}°"
    if lie.position is not None:
        pose += f", at ({lie.position[0]:z.1f}, {lie.position[1]:z.1f}) m"
    drawing = overlaid(place, query, lie, region.extent, f"Overlay, {words}: {pose}")
    return html.figure(drawing, f"{words}: {pose}")


def _values(
    arrays: Sequence[NDArray[np.float32] | None], what: str, titles: Sequence[str]
) -> Iterator[str]:
    """Arrays of the scans on one scale, so that they compare."""
    known = [array for array in arrays if array is not None]
    if len(known) < len(arrays):
        return
    low = min(float(array.min()) for array in known)
    high = max(float(array.max()) for array in known)
    for array, title in zip(known, titles, strict=True):
        role = title.split(":")[0].split(" ")[0]
        yield html.figure(
            value_image(array, low, high, f"{what} of the {title}"), f"{role}: {what}"
        )


def _correlation(region: QueryMap, view: QueryView) -> str | None:
    """The curves of both places; each has its true turn as an upright line."""
    roles: Mapping[str, PlaceView | None] = {"found": view.found, "near": view.nearest}
    known = {role: place for role, place in roles.items() if place and place.curve is not None}
    if not known:
        return None
    curves = {role: place.curve for role, place in known.items() if place.curve is not None}
    low = min(float(curve.min()) for curve in curves.values())
    high = max(float(curve.max()) for curve in curves.values())
    ticks = svg.round_ticks(low, high, 4)
    across = svg.Axis("turn (°)", 0.0, region.period, np.linspace(0, region.period, 5).tolist())
    up = svg.Axis("score", low, high + 0.05 * (high - low or 1), ticks)
    plot = svg.Plot(across, up, width=560, height=200)
    marks = []
    for role, place in known.items():
        degrees = math.degrees(place.true.turn) % region.period
        marks.append(plot.line([(degrees, plot.up.low), (degrees, plot.up.high)], f"{role} true"))
    for role, curve in curves.items():
        rows = np.arange(len(curve) + 1)
        values = np.append(curve, curve[0])  # the turn is circular
        points = zip(rows * region.period / len(curve), values, strict=True)
        marks.append(plot.line([(float(x), float(y)) for x, y in points], role))
        best = int(curve.argmax())
        told = f"{role}: best at {best * region.period / len(curve):.0f}°, {curve[best]:.3f}"
        at = best * region.period / len(curve)
        marks.append(plot.dot(at, float(curve[best]), role, told))
    names = {"found": "the place that was found", "near": "the nearest place"}
    return legend(line_legend(role, names[role]) for role in curves) + plot.drawn(
        marks, "Score over the turn"
    )


def scans_of(view: QueryView) -> list[ScanView]:
    """The places of a query."""
    places = [view.found, view.nearest]
    return [place.scan for place in places if place is not None]
