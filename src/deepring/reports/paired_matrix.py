"""Which differences between the methods of a test are more than chance: every pair, as a table."""

from collections.abc import Sequence
from typing import NamedTuple

from deepring.evaluation.paired import Paired, paired, same_queries
from deepring.reports.escaping import escaped
from deepring.reports.method_results import MethodResults, RegionResults

#: Below this, with every seed, a difference is marked.
LEVEL = 0.05

ABOUT = (
    "Each row against each column, on the same queries: how many the row alone answers rightly, "
    "and how many the column alone does, a pair of numbers for each seed. Marked where McNemar's "
    f"exact test gives p below {LEVEL:g} with every seed. p is of one comparison: of twenty, one "
    "falls below by chance."
)


class PairedMethods(NamedTuple):
    """Two methods on the same queries, by the seeds for which both have their retrievals."""

    seeds: Sequence[int]
    counts: Sequence[Paired]

    @property
    def differs(self) -> bool:
        """Whether one is better by more than chance, and the same one with every seed."""
        signs = {count.one_alone > count.other_alone for count in self.counts}
        return len(signs) == 1 and all(count.p < LEVEL for count in self.counts)


def paired_methods(one: MethodResults, other: MethodResults, radius: float) -> PairedMethods | None:
    """Two methods of one test; None where they have no retrievals of the same queries."""
    compared = {
        seed: paired(first, other.matches[seed], radius)
        for seed, first in one.matches.items()
        if seed in other.matches and same_queries(first, other.matches[seed])
    }
    return PairedMethods(list(compared), list(compared.values())) if compared else None


def paired_matrix(region: RegionResults) -> str | None:
    """The table, the best method first; None where no two methods can be compared."""
    methods = region.ranked()
    pairs = {
        (row, column): pair
        for row, one in enumerate(methods)
        for column, other in enumerate(methods)
        if row < column and (pair := paired_methods(one, other, region.radius)) is not None
    }
    if not pairs:
        return None
    head = "".join(
        f'<th scope="col" title="{escaped(method.label)}">{number}</th>'
        for number, method in enumerate(methods[1:], 2)
    )
    lines = []
    for row, method in enumerate(methods):
        cells = "".join(
            _cell(pairs.get((row, column))) if row < column else "<td></td>"
            for column in range(1, len(methods))
        )
        lines.append(f'<tr><th scope="row">{row + 1} {escaped(method.label)}</th>{cells}</tr>')
    return (
        f'<div class="scroll"><table class="pairs"><caption>{escaped(region.title)}</caption>\n'
        f'<thead><tr><th scope="col">row : column</th>{head}</tr></thead>\n<tbody>\n'
        + "\n".join(lines)
        + "\n</tbody></table></div>"
    )


def _cell(pair: PairedMethods | None) -> str:
    if pair is None:
        return "<td>-</td>"
    words = "<br>".join(f"{each.one_alone}:{each.other_alone}" for each in pair.counts)
    told = "; ".join(
        f"seed {seed}: {each.queries} queries, p {each.p:.2g}"
        for seed, each in zip(pair.seeds, pair.counts, strict=True)
    )
    kind = ' class="differs"' if pair.differs else ""
    return f'<td{kind} title="{escaped(told)}">{words}</td>'
