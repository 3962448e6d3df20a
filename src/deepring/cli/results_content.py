"""The results of an evaluation in what `--as json` prints."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from deepring.evaluation.metrics import Over
from deepring.evaluation.results import Result, result_values


def results_content(
    results: Sequence[Result],
    radius: float,
    over: Over,
    checkpoint: Path | None = None,
    score: float | None = None,
) -> dict[str, Any]:
    """Every result, a row each as in results.csv, and which of them are the headline.

    Args:
        results: of any methods and radii.
        radius: metres; that of the headline.
        over: the queries that the printed tables count over; recalls here are over the answerable.
        checkpoint: of the network.
        score: Recall@1 in validation, by which the checkpoint was chosen.
    """
    return {
        "checkpoint": checkpoint,
        "score": score,
        "radius_m": radius,
        "over": over,
        "results": [result_values(result) for result in results],
    }
