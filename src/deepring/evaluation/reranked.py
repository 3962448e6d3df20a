"""Results of a method after its best candidates are aligned, beside its own results."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from deepring.data.scan_set import ScanSet
from deepring.evaluation.counting import count
from deepring.evaluation.look_up import best_of
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.online import filled
from deepring.evaluation.protocol import Outcome
from deepring.evaluation.recall_curves import MOST
from deepring.evaluation.reranked_labels import NAMES
from deepring.evaluation.task import RetrievalTask, rows_of
from deepring.localization.alignment import Alignment
from deepring.localization.candidates import Rerank, RerankSettings, align_candidates, by_pose
from deepring.localization.location import best_fit
from deepring.progress import Progress
from deepring.search.hits import Hits

Order = tuple[Tensor, Tensor]
"""Places of a query, rows (k,) int64 of the database, best first; the best one's fit k times."""


def evaluate_reranked(
    outcome: Outcome,
    task: RetrievalTask,
    modes: Sequence[Rerank],
    settings: RerankSettings,
    progress: Progress | None = None,
    wrong_beyond: float | None = None,
) -> list[Outcome]:
    """Outcomes of the same method on the same task after re-ranking, one per mode.

    Args:
        outcome: of the method alone, with at least ``settings.candidates`` matches per query.
        task: the same scans as occupancy from above, of the size in ``settings.alignment``.
        modes: 'pose', 'locate'.
        settings: how candidates are selected and aligned.
        progress: called with queries done and their total.
        wrong_beyond: metres, see `deepring.evaluation.counting`.
    """
    matches, query, database = outcome.matches, task.scans.query, task.scans.database
    poses, searched = planar_poses(database), task.scans.searched
    if searched is None:
        searched = np.full(len(matches.query), len(database))
    images = rows_of(query, matches.query)
    found = torch.from_numpy(rows_of(database, matches.place))
    places, others = found[:, : settings.candidates], found[:, settings.candidates :]
    turns = None if matches.turn is None else torch.from_numpy(matches.turn[:, : places.shape[1]])
    orders: dict[Rerank, list[Order]] = {mode: [] for mode in modes}
    started = time.perf_counter()
    for q, repeated in enumerate(places):
        place = repeated[: _distinct(repeated)]
        image, candidates = task.query[images[q : q + 1]][0], task.database[place.numpy()]
        turn = None if turns is None else turns[q, : len(place)]
        alignment = align_candidates(image, turn, candidates, settings)
        for mode in modes:
            order = (
                _by_pose(place, others[q], alignment, settings)
                if mode == "pose"
                else _by_location(place, alignment, poses[: searched[q]], settings)
            )
            orders[mode].append(order)
        if progress is not None:
            progress(q + 1, len(places))
    alone = outcome.results[0]
    per_query = alone.seconds_per_query + (time.perf_counter() - started) / len(places)
    radii = [result.radius_m for result in outcome.results]

    outcomes = []
    for mode in modes:
        widest = max(len(place) for place, _ in orders[mode])
        place, score = (
            torch.stack([filled(values, widest) for values in part])
            for part in zip(*orders[mode], strict=True)
        )
        case = replace(outcome.case, method=NAMES[mode].format(outcome.case.method))
        ranking = TopMatches.of_hits(
            case, query, database, Hits(place, score, None), matches.nearest
        )
        per_scan = alone.seconds_per_scan
        results = count(
            ranking, radii, len(database), per_scan, per_query, wrong_beyond, task.scans.searched
        )
        outcomes.append(Outcome(ranking, results))
    return outcomes


def planar_poses(scans: ScanSet) -> Tensor:
    """x, y and heading (n, 3) in the world of each scan, after the turn of its points."""
    heading = scans.headings if scans.turns is None else scans.headings - scans.turns
    return torch.from_numpy(np.column_stack([scans.positions, heading]))


def _distinct(places: Tensor) -> int:
    """How many places (k,) there are before the last is repeated, see `online.filled`."""
    return 1 + int((places[1:] != places[:-1]).sum())


def _by_pose(
    places: Tensor, others: Tensor, alignment: Alignment, settings: RerankSettings
) -> Order:
    """The candidates by their distance from the query by the alignment, then the others."""
    order = by_pose(alignment, settings)
    ranking = torch.cat([places[order], others])
    return ranking, alignment.score[order[0]].expand(len(ranking))


def _by_location(
    places: Tensor, alignment: Alignment, poses: Tensor, settings: RerankSettings
) -> Order:
    """The places with these ``poses`` nearest to where the best candidate puts the query."""
    best = best_fit(alignment, poses[places], settings)
    away = torch.linalg.vector_norm(poses[:, :2] - best.position, dim=-1)
    order = away.argsort(stable=True)[: best_of(len(poses), MOST)]
    return order, torch.full((len(order),), best.fit)
