"""What tables say of seeds: the values' means and deviations, and the notes below them."""

import statistics
from collections.abc import Callable, Collection, Iterable, Sequence

from deepring.paper.seed_groups import SeedGroup, same_seeds, seeds_of


def about_means(seeds: Sequence[int]) -> str:
    """Describes a value over these seeds."""
    if len(seeds) == 1:
        return f"one run a row, seed {seeds[0]}"
    return f"mean ± sample standard deviation over the seeds {listed(seeds)}"


def about_lacking(rows: Sequence[SeedGroup], label: Callable[[SeedGroup], str]) -> list[str]:
    """A note on the rows that lack seeds which others have, else none."""
    if same_seeds(rows):
        return []
    lacking = [row for row in rows if list(row.results) != seeds_of(rows)]
    have = "; ".join(f"{label(row)} has {listed(row.results)}" for row in lacking)
    return [f"rows are not over the same seeds, so that none is marked best: {have}"]


def listed(seeds: Iterable[int]) -> str:
    """'0, 1, 2'."""
    return ", ".join(map(str, seeds))


def sample_deviation(values: Collection[float]) -> float | None:
    """Standard deviation with n - 1; None for one value."""
    return statistics.stdev(values) if len(values) > 1 else None


def mean_text(values: Collection[float], sign: str = "") -> str:
    """'0.859 ± 0.010', or '0.859' for one seed."""
    deviation = sample_deviation(values)
    mean = f"{statistics.fmean(values):{sign}.3f}"
    return mean if deviation is None else f"{mean} ± {deviation:.3f}"
