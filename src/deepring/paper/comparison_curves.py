"""Precision-recall curves of a comparison, from what its runs retrieved."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from torch import Tensor

from deepring.evaluation.case import Case
from deepring.evaluation.counting import precision_recall
from deepring.evaluation.matches import TopMatches
from deepring.paper.comparison import Comparison
from deepring.paper.comparison_blocks import Block
from deepring.paper.comparison_results import Tested

Curve = tuple[Tensor, Tensor]
"""Precision and recall (t,), the highest threshold first."""

_PANELS = {"table1": "in-domain", "table2": "cross-domain"}


@dataclass(frozen=True, eq=False)
class CurvePanels:
    """The curves of Tables I and II."""

    panels: Mapping[str, Mapping[str, list[Curve]]]
    """Title to method to a curve a seed; without panels and methods that have no curve."""
    lacking: list[str]
    """Which rows have no curve of some of their seeds, in words."""


def curve_panels(
    comparison: Comparison, retrieved: Iterable[tuple[int, TopMatches]]
) -> CurvePanels:
    """A panel for each test in Tables I and II, a curve for each row and seed.

    Args:
        comparison: whose rows and radius are taken.
        retrieved: seed of the run, and what it retrieved in one test; those of a case and seed
            that came before are passed over, as are those that stand in neither table.

    Raises:
        DeepringError: as `precision_recall`.
    """
    blocks = [
        (f"{block.test}, {_PANELS[table.name]}", block)
        for table in comparison.tables
        if table.name in _PANELS
        for block in table.blocks
    ]
    wanted = {row.case: row for _, block in blocks for row in block.rows}
    curves: dict[Case, dict[int, Curve]] = {case: {} for case in wanted}
    for seed, matches in retrieved:
        case = matches.case
        if case in wanted and seed in wanted[case].results and seed not in curves[case]:
            precision, recall, _ = precision_recall(matches, comparison.radius)
            curves[case][seed] = precision, recall
    panels = {title: _panel(block, curves) for title, block in blocks}
    lacking = [text for row in wanted.values() for text in _lacking(row, curves[row.case])]
    return CurvePanels({title: panel for title, panel in panels.items() if panel}, lacking)


def _panel(block: Block, curves: Mapping[Case, Mapping[int, Curve]]) -> dict[str, list[Curve]]:
    """Method to its curves by seed; the training is named where a method has several."""
    methods = [row.case.method for row in block.rows]
    panel = {}
    for row in block.rows:
        several = methods.count(row.case.method) > 1
        label = f"{row.case.method} ({row.case.train})" if several else row.case.method
        of_seed = curves[row.case]
        if of_seed:
            panel[label] = [of_seed[seed] for seed in sorted(of_seed)]
    return panel


def _lacking(row: Tested, curves: Mapping[int, Curve]) -> list[str]:
    seeds = [str(seed) for seed in row.results if seed not in curves]
    return [f"{row.case}, seed {', '.join(seeds)}"] if seeds else []
