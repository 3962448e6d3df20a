"""The curves of a test's methods as small plots, whose axes are the same in every region."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.evaluation.counting import precision_recall
from deepring.evaluation.intervals import wilson
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.metrics import f1_along
from deepring.evaluation.recall_curves import MOST
from deepring.reports import svg
from deepring.reports.method_results import Kinds, MethodResults, RecallPoints, RegionResults
from deepring.reports.table import rate_text

Floats = NDArray[np.float64]

#: Points of a drawn curve; more would not be seen.
_POINTS = 160

#: N whose recall has a dot.
_DOTTED = (1, 5, 10, 15, 20, 25)

#: Methods beside each other of which intervals are drawn; of more they would hide each other.
_WITH_INTERVALS = 9


class Family(NamedTuple):
    """Plots of one kind, one for each region."""

    title: str
    explained: str
    plots: dict[str, str]
    """Title of a region to its plot."""


def families(regions: Sequence[RegionResults], kinds: Kinds) -> Iterator[Family]:
    """Precision and recall, F1, Recall@N and Recall@1 over the radius; those that can be drawn."""
    radii = sorted({r for region in regions for r in _radii(region)})
    recalls = [region.curve(method) for region in regions for method in region.ranked()]
    lowest = min((mean for curve in recalls for _, mean, _, _ in curve), default=0.0)
    drawn: list[tuple[str, str, Callable[[RegionResults], str | None]]] = [
        (
            "Precision and recall",
            "As the threshold of the score falls. The area around a line is the 95 % interval of "
            "the precision, shown for the best method; one line for each seed.",
            lambda region: _precision_plot(region, kinds),
        ),
        (
            "F1",
            "Against the share of the queries that are accepted, from the highest scores on; the "
            "best is marked.",
            lambda region: _f1_plot(region, kinds),
        ),
        (
            "Recall@N",
            _about_recalls(recalls),
            lambda region: _recall_plot(region, kinds, lowest),
        ),
        (
            "Recall@1 over the radius",
            "By the radius within which a place counts as right, with 95 % intervals.",
            lambda region: _radius_plot(region, kinds, radii) if len(radii) > 1 else None,
        ),
    ]
    for title, explained, plot in drawn:
        plots = {r.title: each for r in regions if (each := plot(r)) is not None}
        if plots:
            yield Family(title, explained, plots)


def _about_recalls(curves: Sequence[RecallPoints]) -> str:
    said = (
        "How often a right place is among the first N. The area around the line of the best method "
        "is its 95 % interval. A line ends where a method has no more places to offer."
    )
    known = [[n for n, *_ in curve] for curve in curves]
    if [1, 5] in known:
        said += " Of runs without recalls.csv only N of 1 and 5 is known: evaluate them again."
    return said


class Curve(NamedTuple):
    """How precision and recall go with the threshold, the highest first, (t,) each."""

    precision: Floats
    recall: Floats
    f1: Floats
    accepted: Floats
    """How many queries are accepted, of ``queries``."""
    queries: int


def curve_of(matches: TopMatches, radius: float, wrong_beyond: float | None) -> Curve:
    """The curve of retrievals. Raises DataError where no query has a place within the radius."""
    precision, recall, thresholds = precision_recall(matches, radius, wrong_beyond)
    ordered = np.sort(matches.score[:, 0])
    accepted = len(ordered) - np.searchsorted(ordered, thresholds.numpy())
    return Curve(
        precision.numpy().astype(np.float64),
        recall.numpy().astype(np.float64),
        f1_along(precision, recall).numpy().astype(np.float64),
        accepted.astype(np.float64),
        len(ordered),
    )


def _curves(region: RegionResults) -> Iterator[tuple[MethodResults, list[Curve]]]:
    """The curves of each method's seeds, the worst method first, so that the best is on top."""
    for method in reversed(region.ranked()):
        curves = [
            curve_of(matches, region.radius, region.wrong_beyond)
            for matches in method.matches.values()
            if bool((matches.nearest <= np.float32(region.radius)).any())
        ]
        if curves:
            yield method, curves


def _precision_plot(region: RegionResults, kinds: Kinds) -> str | None:
    plot = svg.Plot(svg.rate_axis("recall"), svg.rate_axis("precision"))
    every = list(_curves(region))
    marks = []
    for number, (method, curves) in enumerate(every):
        kind = kinds.of(method)
        if number == len(every) - 1:  # the best
            marks += [_precision_band(plot, curve, kind) for curve in curves[:1]]
        for curve in curves:
            some = _some(curve)
            points = zip(curve.recall[some], curve.precision[some], strict=True)
            # begun at recall 0 with the first precision, as the area under it
            marks.append(plot.line([(0.0, curve.precision[0]), *points], kind))
    return plot.drawn(marks, f"Precision against recall, {_told(region)}") if every else None


def _precision_band(plot: svg.Plot, curve: Curve, kind: str) -> str:
    some = _some(curve)
    bounds = [
        wilson(p, n) for p, n in zip(curve.precision[some], curve.accepted[some], strict=True)
    ]
    low, high = zip(*bounds, strict=True)
    recalls = curve.recall[some].tolist()
    return plot.band([*zip(recalls, low, strict=True)], [*zip(recalls, high, strict=True)], kind)


def _f1_plot(region: RegionResults, kinds: Kinds) -> str | None:
    plot = svg.Plot(svg.rate_axis("share accepted"), svg.rate_axis("F1"))
    marks = []
    for method, curves in _curves(region):
        kind = kinds.of(method)
        for curve in curves:
            some, shares = _some(curve), curve.accepted / curve.queries
            marks.append(plot.line(zip(shares[some], curve.f1[some], strict=True), kind))
            best = int(curve.f1.argmax())
            told = f"{method.label}: max F1 {rate_text(float(curve.f1[best]))}"
            marks.append(plot.dot(float(shares[best]), float(curve.f1[best]), kind, told))
    return plot.drawn(marks, f"F1, {_told(region)}") if marks else None


def _recall_plot(region: RegionResults, kinds: Kinds, lowest: float) -> str | None:
    across = svg.Axis("places that are looked at, N", 1, MOST, _DOTTED)
    low = min(math.floor(10 * lowest) / 10, 0.9)  # the same in every region
    plot = svg.Plot(across, svg.Axis("Recall@N", low, 1.0, svg.round_ticks(low, 1.0)))
    marks = []
    methods = region.ranked()
    for method in reversed(methods):  # so that the best is on top
        kind, curve = kinds.of(method), region.curve(method)
        if method is methods[0]:
            lower = [(n, bound) for n, _, bound, _ in curve]
            marks.append(plot.band(lower, [(n, bound) for n, _, _, bound in curve], kind))
        marks.append(plot.line([(n, mean) for n, mean, _, _ in curve], kind))
        marks += [
            plot.dot(n, mean, kind, f"{method.label}, R@{n}: {_with_interval(mean, *bounds)}")
            for n, mean, *bounds in curve
            if n in _DOTTED
        ]
    return plot.drawn(marks, f"Recall@N, {_told(region)}") if marks else None


def _radius_plot(region: RegionResults, kinds: Kinds, radii: Sequence[float]) -> str | None:
    ticks = radii if len(radii) <= 6 else svg.round_ticks(radii[0], radii[-1])
    across = svg.Axis("radius (m)", radii[0], radii[-1], ticks)
    plot = svg.Plot(across, svg.rate_axis("Recall@1"))
    marks = []
    methods = region.ranked()
    for method in reversed(methods):
        kind = kinds.of(method)
        own = [radius for radius in radii if method.at(radius)]
        means, low, high = zip(*(method.interval(r, region.over) for r in own), strict=True)
        if len(methods) <= _WITH_INTERVALS:
            marks.append(
                plot.band([*zip(own, low, strict=True)], [*zip(own, high, strict=True)], kind)
            )
        marks.append(plot.line(zip(own, means, strict=True), kind))
        marks += [
            plot.dot(r, mean, kind, f"{method.label}, {r:g} m: {_with_interval(mean, a, b)}")
            for r, mean, a, b in zip(own, means, low, high, strict=True)
        ]
    return plot.drawn(marks, f"Recall@1 over the radius, {_told(region)}") if marks else None


def _some(curve: Curve) -> NDArray[np.int64]:
    """Up to `_POINTS` points of a curve, evenly along what is accepted, and the best F1."""
    along = np.linspace(curve.accepted[0], curve.accepted[-1], _POINTS)
    some = np.searchsorted(curve.accepted, along).clip(max=len(curve.accepted) - 1)
    return np.unique(np.append(some, curve.f1.argmax()))


def _radii(region: RegionResults) -> set[float]:
    return {
        result.radius_m
        for method in region.methods
        for results in method.results.values()
        for result in results
    }


def _with_interval(mean: float, low: float, high: float) -> str:
    return f"{mean:.3f} ({low:.3f} to {high:.3f})"


def _told(region: RegionResults) -> str:
    """The methods with their Recall@1, for those who hear the page."""
    words = [f"{m.label} {region.interval(m)[0]:.3f}" for m in region.ranked()]
    return f"{region.title}. Recall@1: {', '.join(words)}"
