"""The parts of a page that set methods side by side: intervals, curves, and what the lines mean."""

from collections.abc import Iterator, Sequence

from deepring.reports import html
from deepring.reports.escaping import escaped
from deepring.reports.interval_plot import interval_plot
from deepring.reports.method_plots import families
from deepring.reports.method_results import Kinds, RegionResults

#: What is said of intervals, once on a page.
ABOUT_INTERVALS = (
    "Bars are 95 % intervals (Wilson) for the queries of one seed. Consecutive queries are alike, "
    "so that the true uncertainty is rather larger."
)


def side_by_side(
    regions: Sequence[RegionResults], kinds: Kinds, first: str = "Method"
) -> Iterator[str]:
    """Recall@1 of all methods in each region, with intervals; ``first`` is what the rows are."""
    plots = [f"<div>{interval_plot(region, kinds, first)}</div>" for region in regions]
    yield html.pictures_in_rows(plots, wide=True)
    yield html.soft(ABOUT_INTERVALS)


def curves(regions: Sequence[RegionResults], kinds: Kinds) -> Iterator[str]:
    """A row of small plots of each kind, one plot a region."""
    for family in families(regions, kinds):
        plots = "\n".join(f"<div>{plot}</div>" for plot in family.plots)
        yield (
            f"<figure><h3>{escaped(family.title)}</h3>\n{legend(regions, kinds)}\n"
            f'<div class="plots row">\n{plots}\n</div>\n'
            f"<figcaption>{escaped(family.explained)}</figcaption></figure>"
        )


def legend(regions: Sequence[RegionResults], kinds: Kinds) -> str:
    """Each method with its line; re-ranked ones are dashed."""
    shown = {method.label: method for region in regions for method in region.methods}
    items = "".join(
        '<li><svg viewBox="0 0 26 10" aria-hidden="true">'
        f'<path class="line {kinds.of(method)}" d="M0 5H26"/></svg>{escaped(label)}</li>'
        for label, method in shown.items()
    )
    return f'<ul class="legend">{items}</ul>'
