"""The queries of a test: maps of all methods, and a map on which one chooses a query to look at.

Without scripts: the map's marks are links to the panels of queries, and rules of style show the one
that the pointer rests on, that has the keyboard's focus, or that the page's address names.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from deepring.evaluation.case import in_file_names
from deepring.reports import html
from deepring.reports.escaping import escaped
from deepring.reports.ground_frame import Frame
from deepring.reports.marks import mark
from deepring.reports.query_map import NAMES, hit_maps, kinds_of, map_legend, places
from deepring.reports.query_panel import Names, query_panel, scans_of
from deepring.reports.query_view import QueryMap
from deepring.reports.scan_images import PLACE, QUERY, defined, scan_image


def query_sections(regions: Sequence[QueryMap]) -> Iterator[str]:
    """The sections of all regions."""
    slugs: list[str] = []
    for region in regions:
        slug = in_file_names(region.title)
        names = Names(slug if slug not in slugs else f"{slug}-{len(slugs)}")
        slugs.append(names.region)
        yield html.subheading(f"{region.title}: {_counts(region)}")
        if len(region.by_method) > 1:
            yield map_legend()
            yield html.pictures_in_rows(hit_maps(region))
        yield _explorer(region, names)


def _counts(region: QueryMap) -> str:
    kinds = kinds_of(region.metres, region.nearest, region.radius)
    return ", ".join(f"{(kinds == kind).sum()} {words}" for kind, words in NAMES.items())


def _explorer(region: QueryMap, names: Names) -> str:
    views = list(region.views)
    if not views:
        return f'<div class="queries alone">{_map(region, names)}</div>'
    wrong = [view for view in views if not region.right[view.row] and region.answerable[view.row]]
    first = max(wrong or views, key=lambda view: (region.scores[view.row], -view.row))
    panels = "\n".join(
        query_panel(
            region,
            view,
            names,
            [*views[max(number - 1, 0) : number], *views[number + 1 : number + 2]],
            view is first,
        )
        for number, view in enumerate(views)
    )
    return (
        f"<style>{_rules(region, names)}</style>\n"
        f"{defined(_images(region, names))}\n"
        f'<div class="queries">\n{_map(region, names)}\n'
        f'<div class="panels">\n{panels}\n</div></div>'
    )


def _images(region: QueryMap, names: Names) -> Iterator[str]:
    """The scans of all panels, each once."""
    seen = set()
    for view in region.views:
        number = view.scan.number
        yield scan_image(names.query_scan(number), view.scan.image, region.extent, QUERY)
        for scan in scans_of(view):
            if scan.number not in seen:
                seen.add(scan.number)
                yield scan_image(names.place_scan(scan.number), scan.image, region.extent, PLACE)


def _rules(region: QueryMap, names: Names) -> str:
    """Rules that show a panel, and the way to its place, while its mark is pointed at."""
    rules = []
    for view in region.views:
        name = names.query(view.scan.number)
        mark = f'.map a[href="#{name}"]'
        rules.append(
            f".queries:has({mark}:is(:hover,:focus-visible)) #{name}{{display:block}}"
            f".queries:has(#{name}:target) {mark}{{--w:1}}"
        )
    return "".join(rules)


def _map(region: QueryMap, names: Names) -> str:
    """The map, on which queries with pictures are links."""
    frame = Frame(np.concatenate([region.places, region.queries]))
    kinds = kinds_of(region.metres, region.nearest, region.radius)
    shown = {view.row: view for view in region.views}
    parts = [places(frame, region)]
    linked = []
    for row, (position, kind) in enumerate(zip(region.queries, kinds, strict=True)):
        x, y = frame.at(position)
        title = f"<title>{escaped(_told(region, row, str(kind)))}</title>"
        drawn = mark((x, y), str(kind))
        if row not in shown:
            parts.append(f"<g>{title}{drawn}</g>")
            continue
        to_x, to_y = frame.at(region.places[region.found[row]])
        linked.append(
            f'<a href="#{names.query(int(region.numbers[row]))}">{title}'
            f'<path class="way" d="M{x:g} {y:g}L{to_x:g} {to_y:g}"/>'
            f'<circle class="halo" cx="{x:g}" cy="{y:g}" r="6"/>{drawn}</a>'
        )
    described = f"{region.title}, {region.method}: {_counts(region)}"
    drawing = frame.drawn([*parts, *linked], region.axes, described, "map")
    return (
        f'<div class="chart" id="{names.map}">{map_legend()}{drawing}'
        f'<p class="soft">{escaped(_about(region))}</p></div>'
    )


def _about(region: QueryMap) -> str:
    places = f"What {region.method} found, from above."
    if not region.views:
        return places
    wrong = int((region.answerable & ~region.right).sum())
    shown = sum(bool(region.answerable[v.row] and not region.right[v.row]) for v in region.views)
    return (
        f"{places} Ringed queries have pictures: {len(region.views)} of {len(region.queries)}, "
        f"{shown} of the {wrong} wrong ones, those of the highest scores, and an even sample of "
        "the others. Point at one, or choose it; a line leads to the place that was found. In "
        "pictures the query is orange and places are blue; x is forward, upwards."
    )


def _told(region: QueryMap, row: int, kind: str) -> str:
    return (
        f"query {region.numbers[row]}: {NAMES[kind]}; found {region.metres[row]:.1f} m away, "
        f"nearest {region.nearest[row]:.1f} m"
    )
