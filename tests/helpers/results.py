"""Results of evaluations, made up."""

import re

from deepring.evaluation.case import Case
from deepring.evaluation.results import Result


def result_of(
    case: Case,
    radius: float,
    counts: tuple[int, int, int] = (50, 100, 50),
    rates: tuple[float, float, float, float] = (0.5, 0.9, 0.8, 0.7),
    seconds: tuple[float, float] = (0.01, 0.002),
    **fields: float,
) -> Result:
    """A result of a case, right within ``radius`` metres and wrong beyond.

    ``counts`` are places, queries and answerable ones; ``rates`` Recall@1, Recall@5, F1 and AUC.
    """
    recall_1, recall_5, f1_max, auc = rates
    further = {"wrong_beyond_m": radius, "recall_1_percent": recall_5, "ap": auc} | fields
    return Result(
        case=case,
        radius_m=radius,
        database=counts[0],
        queries=counts[1],
        answerable=counts[2],
        recall_1=recall_1,
        recall_5=recall_5,
        f1_max=f1_max,
        auc=auc,
        seconds_per_scan=seconds[0],
        seconds_per_query=seconds[1],
        **further,
    )


def without_intervals(text: str) -> str:
    """A cell's number, or a file's text, without the intervals in parentheses."""
    return re.sub(r" \(\d?\.\d\d-\d?\.\d\d\)", "", text)
