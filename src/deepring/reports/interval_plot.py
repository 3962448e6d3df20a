"""Recall@1 of a test's methods below each other, each with its seeds and its 95 % interval."""

from collections.abc import Iterator

from deepring.reports.escaping import escaped
from deepring.reports.method_results import Kinds, MethodResults, RegionResults
from deepring.reports.results_table import bounds_text


def interval_plot(region: RegionResults, kinds: Kinds, first: str = "Method") -> str:
    """A table whose middle column is drawn, the best method first.

    Its axis is the same for every region. ``first`` says what the rows are.
    """
    words = f"Recall@1 within {region.radius:g} m"
    rows = "\n".join(_row(region, method, kinds) for method in region.ranked())
    ticks = "".join(f'<span style="left:{100 * tick:g}%">{tick:g}</span>' for tick in _TICKS)
    return (
        f'<div class="scroll"><table class="intervals"><caption>{escaped(region.title)}</caption>\n'
        f'<thead><tr><th scope="col">{escaped(first)}</th><th scope="col">{words}</th>'
        '<th scope="col">95 % interval</th></tr></thead>\n'
        f"<tbody>\n{rows}\n</tbody>\n"
        f'<tfoot><tr aria-hidden="true"><td></td><td><div class="ticks">{ticks}</div></td>'
        "<td></td></tr></tfoot></table></div>"
    )


_TICKS = (0, 0.25, 0.5, 0.75, 1)


def _row(region: RegionResults, method: MethodResults, kinds: Kinds) -> str:
    mean, low, high = region.interval(method)
    recalls = method.recalls(region.radius, region.over)
    told = ", ".join(f"seed {seed}: {value:.3f}" for seed, value in recalls.items())
    marks = "".join(_marks(mean, low, high, list(recalls.values())))
    return (
        f'<tr class="{kinds.of(method)}"><th scope="row">{escaped(method.label)}</th>'
        f'<td><div class="range" title="{escaped(told)}">{marks}</div></td>'
        f"<td>{mean:.3f} {bounds_text(low, high)}</td></tr>"
    )


def _marks(mean: float, low: float, high: float, of_seeds: list[float]) -> Iterator[str]:
    """The interval, a small mark for each seed where there are several, and the mean."""
    yield f'<i class="whisker" style="left:{100 * low:.2f}%;width:{100 * (high - low):.2f}%"></i>'
    for value in of_seeds if len(of_seeds) > 1 else ():
        yield f'<i class="seed" style="left:{100 * value:.2f}%"></i>'
    yield f'<i class="mean" style="left:{100 * mean:.2f}%"></i>'
