"""Rows of a comparison or an ablation with all that a page shows of them.

A row of a table has its results at one radius; here are those at all radii, and the retrievals.
"""

from collections.abc import Sequence

from deepring.evaluation.case import Case
from deepring.evaluation.matches import TopMatches, matches_in
from deepring.evaluation.recall_curves import RecallCurve, read_recall_curves
from deepring.evaluation.results import Result
from deepring.paper.seed_groups import Run, SeedGroup
from deepring.reports.method_results import MethodResults, RegionResults


class SweepRows:
    """Finds what runs hold of the rows that were made of them."""

    def __init__(self, runs: Sequence[Run]) -> None:
        self._runs = {id(result): run for run in runs for result in run.results}
        self._matches: dict[str, dict[Case, TopMatches]] = {}
        self._curves: dict[str, list[RecallCurve]] = {}

    def method(self, row: SeedGroup, name: str, trained_on: str = "") -> MethodResults:
        """A row as a method of a region."""
        results: dict[int, list[Result]] = {}
        matches: dict[int, TopMatches] = {}
        curves: dict[int, list[RecallCurve]] = {}
        for seed, result in row.results.items():
            run = self._runs[id(result)]
            results[seed] = [each for each in run.results if each.case == result.case]
            found = self._matches_of(run).get(result.case)
            if found is not None:
                matches[seed] = found
            if known := [each for each in self._curves_of(run) if each.case == result.case]:
                curves[seed] = known
        return MethodResults(name, results, matches, trained_on, curves)

    def region(self, title: str, methods: Sequence[MethodResults], row: SeedGroup) -> RegionResults:
        """Methods of one region; ``row`` is any of its rows, which tells how they were counted."""
        result = next(iter(row.results.values()))
        return RegionResults(title, methods, result.radius_m, result.wrong_beyond_m, row.over)

    def _matches_of(self, run: Run) -> dict[Case, TopMatches]:
        if run.folder not in self._matches:
            self._matches[run.folder] = {m.case: m for m in matches_in(run.folder)}
        return self._matches[run.folder]

    def _curves_of(self, run: Run) -> list[RecallCurve]:
        if run.folder not in self._curves:
            self._curves[run.folder] = read_recall_curves(run.folder)
        return self._curves[run.folder]
