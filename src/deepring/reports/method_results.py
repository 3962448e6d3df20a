"""What a page shows of a test: its methods side by side, each with its results and retrievals."""

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from deepring.evaluation.intervals import wilson
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.metrics import Over
from deepring.evaluation.recall_curves import RecallCurve
from deepring.evaluation.reranked_labels import method_label
from deepring.evaluation.results import RecallName, Result
from deepring.reports.results_table import counted, recall, share_over
from deepring.reports.style import PALETTE

#: N, the mean Recall@N and the ends of its 95 % interval.
RecallPoints = list[tuple[int, float, float, float]]


@dataclass(frozen=True, eq=False)
class MethodResults:
    """A method, or a setting of one, in one test region."""

    name: str
    results: Mapping[int, Sequence[Result]]
    """By seed, at all radii."""
    matches: Mapping[int, TopMatches] = field(default_factory=dict)
    """By seed, those that there are."""
    trained_on: str = ""
    """Said where there are several of one name."""
    curves: Mapping[int, Sequence[RecallCurve]] = field(default_factory=dict)
    """By seed, at all radii, those that there are."""

    @property
    def label(self) -> str:
        """The name, and where there are several what this one was trained on."""
        return f"{self.name} ({self.trained_on})" if self.trained_on else self.name

    @property
    def is_reranked(self) -> bool:
        """Whether it is another one's, with its candidates aligned."""
        return method_label(self.name) != self.name

    def at(self, radius: float) -> dict[int, Result]:
        """The results at a radius by seed."""
        found = {}
        for seed, results in self.results.items():
            for result in results:
                if math.isclose(result.radius_m, radius):
                    found[seed] = result
        return found

    def recalls(self, radius: float, over: Over, name: RecallName = "recall_1") -> dict[int, float]:
        """A recall at a radius, by seed."""
        return {seed: recall(r, name, over) for seed, r in self.at(radius).items()}

    def interval(
        self, radius: float, over: Over, name: RecallName = "recall_1"
    ) -> tuple[float, float, float]:
        """The mean of a recall over the seeds, and its 95 % interval by the queries of one seed."""
        results = self.at(radius).values()
        mean = statistics.fmean(recall(result, name, over) for result in results)
        queries = statistics.fmean(counted(result, over) for result in results)
        return mean, *wilson(mean, queries)

    def recall_curve(self, radius: float, over: Over) -> RecallPoints:
        """N, the mean Recall@N over the seeds, and its 95 % interval by the queries of one seed.

        Of runs that hold no curve only N of 1 and 5.
        """
        results = self.at(radius)
        curves = [
            [share_over(recall, results[seed], over) for recall in curve.recalls]
            for seed, of_seed in self.curves.items()
            for curve in of_seed
            if seed in results and math.isclose(curve.radius_m, radius)
        ]
        if len(curves) < len(results):
            names: dict[int, RecallName] = {1: "recall_1", 5: "recall_5"}
            return [(n, *self.interval(radius, over, name)) for n, name in names.items()]
        queries = statistics.fmean(counted(result, over) for result in results.values())
        means = map(statistics.fmean, zip(*curves, strict=False))  # as far as the shortest
        return [(n, mean, *wilson(mean, queries)) for n, mean in enumerate(means, 1)]


@dataclass(frozen=True, eq=False)
class RegionResults:
    """The methods that were tested in one region, on the same queries."""

    title: str
    methods: Sequence[MethodResults]
    radius: float
    """Metres, within which a place is right in all but the curves over radii."""
    wrong_beyond: float | None
    over: Over

    @property
    def same_seeds(self) -> bool:
        """Whether all methods have the same seeds, and so were asked the same queries."""
        return len({frozenset(method.at(self.radius)) for method in self.ranked()}) == 1

    def ranked(self) -> list[MethodResults]:
        """Those with a result at the radius, the highest mean Recall@1 first."""
        known = [method for method in self.methods if method.at(self.radius)]
        return sorted(known, key=lambda m: -self.interval(m)[0])

    def interval(
        self, method: MethodResults, name: RecallName = "recall_1"
    ) -> tuple[float, float, float]:
        """A recall of a method at the radius, and its 95 % interval."""
        return method.interval(self.radius, self.over, name)

    def curve(self, method: MethodResults) -> RecallPoints:
        """The Recall@N of a method at the radius, see `MethodResults.recall_curve`."""
        return method.recall_curve(self.radius, self.over)


class Kinds:
    """The look of each method, the same on the whole page.

    A method has a colour, with the colours' second round dotted. Its re-ranked twin is dashed, and
    where it was trained on several datasets, all but the first one are paler.
    """

    def __init__(self, regions: Iterable[RegionResults]) -> None:
        regions = list(regions)
        methods = [method for region in regions for method in (*region.ranked(), *region.methods)]
        names = dict.fromkeys(method_label(method.name) for method in methods)
        self._numbers = {name: number for number, name in enumerate(names)}
        self._trainings = list(dict.fromkeys(m.trained_on for m in methods if m.trained_on))

    def of(self, method: MethodResults) -> str:
        """The classes of a method's marks."""
        number = self._numbers[method_label(method.name)]
        again = " again" if method.is_reranked else ""
        other = method.trained_on and self._trainings.index(method.trained_on) > 0
        pale = " pale" if other else ""
        return f"m{number % len(PALETTE)} r{min(number // len(PALETTE), 2)}{again}{pale}"
