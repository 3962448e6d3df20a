"""A run, a sweep or a comparison as one HTML page."""

from pathlib import Path

from deepring.errors import FileError
from deepring.experiment.run_page import run_page


def report(folder: Path, pictures: int = 120) -> str:
    """The page of an evaluated run.

    Args:
        folder: of a run.
        pictures: the most queries that are shown with their scans, over all regions. These are
            read from where the run's config says.

    Raises:
        DeepringError: a folder of neither, or files that cannot be read.
    """
    if not (folder / "results.csv").is_file():
        raise FileError(
            f"{folder}: no results.csv in it; expected the folder of an evaluated run, such as "
            "outputs/demo/latest"
        )
    return run_page(folder, pictures)
