"""The parts of a page that set methods side by side: the best, intervals, curves and pairs."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from deepring.reports import html, marks
from deepring.reports.escaping import escaped
from deepring.reports.interval_plot import interval_plot
from deepring.reports.method_plots import families
from deepring.reports.method_results import Kinds, MethodResults, RegionResults
from deepring.reports.paired_matrix import ABOUT, PairedMethods, paired_matrix, paired_methods
from deepring.reports.results_table import bounds_text

#: What is said of intervals, once on a page.
ABOUT_INTERVALS = (
    "Bars are 95 % intervals (Wilson) for the queries of one seed. Consecutive queries are alike, "
    "so that the true uncertainty is rather larger. Where there are several seeds, thin marks are "
    "the seeds, and the dot is their mean."
)

#: Methods of a region up to which the curves of re-ranked ones are drawn too.
_MOST = 10


def leaders(regions: Sequence[RegionResults], what: str) -> Iterator[str]:
    """Which is the best in most tests, and in each how far it is before the next."""
    ranked = [region for region in regions if region.same_seeds]
    wins = Counter(region.ranked()[0].name for region in ranked)
    if wins:
        name, count = wins.most_common(1)[0]
        won = [region for region in ranked if region.ranked()[0].name == name]
        sure = sum(_is_sure(region) for region in won)
        tests = f"{count} of {len(regions)} tests" if len(regions) > 1 else regions[0].title
        chance = f", in {sure} of them by more than chance" if len(won) > 1 else ""
        yield html.lead(f"{name} has the highest Recall@1 in {tests}{chance}.")
    else:
        yield html.lead(f"No {what} is named best: not all have the same seeds.")
    yield html.points(map(_leader, regions))


def _is_sure(region: RegionResults) -> bool:
    """Whether the best is before the next by more than chance."""
    first, *others = region.ranked()
    pair = paired_methods(first, others[0], region.radius) if others else None
    return pair is not None and pair.differs


def _leader(region: RegionResults) -> str:
    first, *others = region.ranked()
    said = f"{region.title}: {first.label} {_recall(region, first)}"
    if not others:
        return f"{said}."
    said += f", then {others[0].label} {_recall(region, others[0])}"
    if not region.same_seeds:
        return f"{said}; not all have the same seeds."
    pair = paired_methods(first, others[0], region.radius)
    return f"{said}. {_paired(pair)}" if pair is not None else f"{said}."


def _recall(region: RegionResults, method: MethodResults) -> str:
    mean, low, high = region.interval(method)
    return f"{mean:.3f} {bounds_text(low, high)}"


def _paired(pair: PairedMethods) -> str:
    """What the paired test says, in words."""
    each = "; ".join(
        f"{one.one_alone} to {one.other_alone} of {one.queries}, p {one.p:.2g} (seed {seed})"
        for seed, one in zip(pair.seeds, pair.counts, strict=True)
    )
    verdict = "More than chance" if pair.differs else "May be chance"
    return f"{verdict}: queries that only the one or only the other answers, {each}."


def side_by_side(
    regions: Sequence[RegionResults], kinds: Kinds, first: str = "Method"
) -> Iterator[str]:
    """Recall@1 of all methods in each region, with intervals; ``first`` is what the rows are."""
    plots = [f"<div>{interval_plot(region, kinds, first)}</div>" for region in regions]
    yield html.pictures_in_rows(plots, "wide")
    yield html.soft(ABOUT_INTERVALS)


def curves(regions: Sequence[RegionResults], kinds: Kinds) -> Iterator[str]:
    """A row of small plots of each kind, one plot a region; of one region, a row of all kinds."""
    drawn = [_without_reranked(region) for region in regions]
    if any(len(a.methods) < len(b.methods) for a, b in zip(drawn, regions, strict=True)):
        yield html.soft("Curves of re-ranked methods are left out where there are many lines.")
    if len(drawn) == 1:
        plots = (
            f"<h3>{escaped(family.title)}</h3>{plot}{html.soft(family.explained)}"
            for family in families(drawn, kinds)
            for plot in family.plots.values()
        )
        yield _row(legend(drawn, kinds), plots)
        return
    for family in families(drawn, kinds):
        plots = (f"<b>{escaped(title)}</b>{plot}" for title, plot in family.plots.items())
        head = f"<h3>{escaped(family.title)}</h3>\n{legend(drawn, kinds)}"
        yield _row(head, plots, f"<figcaption>{escaped(family.explained)}</figcaption>")


def _row(head: str, plots: Iterable[str], below: str = "") -> str:
    each = "\n".join(f"<div>{plot}</div>" for plot in plots)
    return f'<figure>{head}\n<div class="plots row">\n{each}\n</div>\n{below}</figure>'


def _without_reranked(region: RegionResults) -> RegionResults:
    if len(region.methods) <= _MOST:
        return region
    return replace(region, methods=[m for m in region.methods if not m.is_reranked])


def legend(regions: Sequence[RegionResults], kinds: Kinds) -> str:
    """Each method with its line."""
    shown: dict[str, str] = {}
    for method in (method for region in regions for method in region.methods):
        shown.setdefault(kinds.of(method), method.label)
    return marks.legend(marks.line_legend(kind, label) for kind, label in shown.items())


def pairs(regions: Sequence[RegionResults]) -> Iterator[str]:
    """The matrix of each region."""
    matrices = [matrix for region in regions if (matrix := paired_matrix(region)) is not None]
    if not matrices:
        yield html.paragraph("No two have retrievals of the same queries (retrievals/*.csv).")
        return
    yield html.paragraph(ABOUT)
    yield from matrices
