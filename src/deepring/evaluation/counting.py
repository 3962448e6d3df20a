"""Results of matches: the first right place of each query at all radii, in one pass.

A best place within the radius is right. One beyond ``wrong_beyond`` metres is wrong, and one
between is in a grey zone: if it is accepted, it is neither right nor wrong for precision, recall,
F1, AUC and AP, and it is no hit for Recall@K. Without ``wrong_beyond`` there is no grey zone.
"""

import logging
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.metrics import (
    area_under,
    average_precision,
    curve_of_ranks,
    f1_along,
    first_right_among,
    one_percent,
    recall_of_ranks,
)
from deepring.evaluation.results import Result

log = logging.getLogger(__name__)


def count(
    matches: TopMatches,
    radii: Sequence[float],
    places: int,
    per_scan: float,
    per_query: float,
    wrong_beyond: float | None = None,
    searched: NDArray[np.int64] | None = None,
) -> list[Result]:
    """One result per radius (metres), in the order of ``radii``.

    A radius within which no query has an answer is left out with a warning. If that is the first
    radius, the headline, DataError is raised.

    Args:
        matches: the best places per query, as many as `deepring.evaluation.look_up.best_of` says,
            or all that were compared where these are fewer.
        radii: the headline first.
        places: number of places in the database.
        per_scan: seconds from points to descriptor, repeated in each result.
        per_query: seconds to search all places that a query is compared with, likewise.
        wrong_beyond: metres, see above.
        searched: (q,) with how many places each query was compared, where not with all.

    Raises:
        ConfigError: a ``wrong_beyond`` below a radius.
    """
    check_grey_zone(radii, wrong_beyond)
    top = torch.from_numpy(matches.score[:, 0])
    percent: int | Tensor = one_percent(places)
    if searched is not None:
        percent = torch.tensor([one_percent(number) for number in searched.tolist()])
    results = []
    for radius, ranks in zip(radii, _ranks(matches, radii), strict=True):
        answerable = int((ranks > 0).sum())
        if not answerable and radius != radii[0]:
            log.warning("%s: no query has a place within %g m; left out", matches.case.test, radius)
            continue
        beyond = radius if wrong_beyond is None else wrong_beyond
        precision, recall, _ = curve_of_ranks(top, ranks, radius, _wrong(matches, beyond))
        result = Result(
            case=matches.case,
            radius_m=float(radius),
            wrong_beyond_m=float(beyond),
            database=places,
            queries=len(ranks),
            answerable=answerable,
            recall_1=float(recall_of_ranks(ranks, 1, radius)),
            recall_5=float(recall_of_ranks(ranks, 5, radius)),
            recall_1_percent=float(recall_of_ranks(ranks, percent, radius)),
            f1_max=float(f1_along(precision, recall).amax()),
            auc=float(area_under(precision, recall)),
            ap=float(average_precision(precision, recall)),
            seconds_per_scan=per_scan,
            seconds_per_query=per_query,
        )
        results.append(result)
    return results


def precision_recall(
    matches: TopMatches, radius: float, wrong_beyond: float | None = None
) -> tuple[Tensor, Tensor, Tensor]:
    """Precision, recall and thresholds (t,) of the best places, the highest threshold first.

    As `deepring.evaluation.metrics.place_precision_recall`, with the grey zone of this module.
    Raises DataError where no query has a place within the radius (metres), and ConfigError for a
    ``wrong_beyond`` below it.
    """
    check_grey_zone([radius], wrong_beyond)
    (ranks,) = _ranks(matches, [radius])
    top = torch.from_numpy(matches.score[:, 0])
    return curve_of_ranks(top, ranks, radius, _wrong(matches, wrong_beyond or radius))


def check_grey_zone(radii: Sequence[float], wrong_beyond: float | None) -> None:
    """Raise ConfigError unless ``wrong_beyond`` is None or at least the largest radius, metres."""
    if wrong_beyond is None:
        return
    checks.number("wrong_beyond", wrong_beyond, "metres")
    if wrong_beyond < max(radii):
        raise ConfigError(
            f"wrong_beyond: {wrong_beyond:g}, expected at least the largest radius, "
            f"{max(radii):g} m, within which places are right"
        )


def _wrong(matches: TopMatches, beyond: float) -> Tensor:
    return torch.from_numpy(matches.distance[:, 0] > np.float32(beyond))


def _ranks(matches: TopMatches, radii: Sequence[float]) -> Tensor:
    return first_right_among(
        torch.from_numpy(matches.distance), torch.from_numpy(matches.nearest), radii
    )
