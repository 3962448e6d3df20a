"""Results of matches: the first right place of each query at all radii, in one pass."""

import logging
from collections.abc import Sequence

import torch
from torch import Tensor

from deepring.evaluation.matches import TopMatches
from deepring.evaluation.metrics import (
    area_under,
    curve_of_ranks,
    f1_along,
    first_right_among,
    recall_of_ranks,
)
from deepring.evaluation.results import Result

log = logging.getLogger(__name__)


def count(
    matches: TopMatches, radii: Sequence[float], places: int, per_scan: float, per_query: float
) -> list[Result]:
    """One result per radius (metres), in the order of ``radii``.

    A radius within which no query has an answer is left out with a warning. If that is the first
    radius, the headline, DataError is raised.

    Args:
        matches: the best five places per query, or all that were compared where these are fewer.
        radii: the headline first.
        places: number of places in the database.
        per_scan: seconds from points to descriptor, repeated in each result.
        per_query: seconds to search the whole database, likewise.
    """
    top = torch.from_numpy(matches.score[:, 0])
    results = []
    for radius, ranks in zip(radii, _ranks(matches, radii), strict=True):
        answerable = int((ranks > 0).sum())
        if not answerable and radius != radii[0]:
            log.warning("%s: no query has a place within %g m; left out", matches.case.test, radius)
            continue
        precision, recall, _ = curve_of_ranks(top, ranks, radius)
        result = Result(
            case=matches.case,
            radius_m=float(radius),
            database=places,
            queries=len(ranks),
            answerable=answerable,
            recall_1=float(recall_of_ranks(ranks, 1, radius)),
            recall_5=float(recall_of_ranks(ranks, 5, radius)),
            f1_max=float(f1_along(precision, recall).amax()),
            auc=float(area_under(precision, recall)),
            seconds_per_scan=per_scan,
            seconds_per_query=per_query,
        )
        results.append(result)
    return results


def precision_recall(matches: TopMatches, radius: float) -> tuple[Tensor, Tensor, Tensor]:
    """Precision, recall and thresholds (t,) of the best places, the highest threshold first.

    As `deepring.evaluation.metrics.place_precision_recall`. Raises DataError where no query has a
    place within the radius (metres).
    """
    (ranks,) = _ranks(matches, [radius])
    return curve_of_ranks(torch.from_numpy(matches.score[:, 0]), ranks, radius)


def _ranks(matches: TopMatches, radii: Sequence[float]) -> Tensor:
    return first_right_among(
        torch.from_numpy(matches.distance), torch.from_numpy(matches.nearest), radii
    )
