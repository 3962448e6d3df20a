"""A run, a sweep or a comparison as one HTML page."""

from pathlib import Path

from deepring.evaluation.metrics import Over
from deepring.experiment.run_page import run_page
from deepring.experiment.sweep_page import sweep_page


def report(
    folder: Path,
    pictures: int = 120,
    radius: float | None = None,
    over: Over | None = None,
    *,
    mix: bool = False,
    beside: Path | None = None,
) -> str:
    """The page of an evaluated run, or of all finished runs in a folder.

    Args:
        folder: of a run, or of a sweep or a comparison.
        pictures: of a run, the most queries that are shown with their scans, over all regions.
            These are read from where the run's config says.
        radius: metres, within which a place is right; by default the first of a run's config, and
            10 for several runs.
        over: recall as the share of the answerable queries, or of all; by default as a run's config
            has it, and answerable ones for several runs.
        mix: let runs on different data or under different protocols stand beside each other.
        beside: the folder of the page, from which it leads to the pages of runs; ``folder`` by
            default.

    Raises:
        DeepringError: a folder of neither, a radius without results, runs that cannot stand beside
            each other, or files that cannot be read.
    """
    if (folder / "results.csv").is_file():
        return run_page(folder, pictures, radius, over)
    return sweep_page([folder], radius or 10.0, over or "answerable", beside or folder, mix=mix)
