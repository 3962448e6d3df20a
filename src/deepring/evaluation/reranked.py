"""A method with its best candidates aligned: further rows beside its own."""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from deepring.evaluation.described import Described
from deepring.evaluation.descriptors import Labels
from deepring.evaluation.protocol import Outcome, Side, Task, score_sides
from deepring.localization.candidates import (
    Candidates,
    Rerank,
    RerankSettings,
    align_candidates,
    by_location,
    by_pose,
)
from deepring.methods.base import Comparison, Method
from deepring.methods.describe import describe_all
from deepring.methods.index_for import index_for
from deepring.progress import Progress
from deepring.search.hits import Hits

#: What a re-ranked method is called in results, so that nobody takes one row for another.
NAMES: dict[Rerank, str] = {
    "pose": "{} + pose re-ranking",
    "locate": "{} + map poses (localisation)",
}


def evaluate_reranked(
    outcome: Outcome,
    method: Method,
    task: Task,
    images: Task,
    modes: Sequence[Rerank],
    settings: RerankSettings,
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> list[Outcome]:
    """Outcomes of the same method on the same task, one a mode.

    Args:
        outcome: of the method alone; its rows give labels, radii and the time of a scan.
        method: that is searched with, on ``device``.
        task: its scans and rasters.
        images: the same scans as occupancy from above, of 120 x 120 cells or as set.
        modes: 'pose', 'locate'.
        settings: of candidates and alignment.
        device: of the method.
        progress: called with queries done and their total.
    """
    started = time.perf_counter()
    hits = _search(method, task, settings.candidates, device)
    poses = _planar_poses(task.database)
    scores = {mode: [] for mode in modes}  # type: dict[Rerank, list[Tensor]]
    for q in range(len(task.query)):
        candidates = align_candidates(
            images.query.rasters[q : q + 1][0],
            hits.place[q],
            None if hits.turn is None else hits.turn[q],
            images.database.rasters[hits.place[q].numpy()],
            settings,
        )
        for mode in modes:
            scores[mode].append(_SCORES[mode](candidates, poses, settings))
        if progress is not None:
            progress(q + 1, len(task.query))
    per_query = (time.perf_counter() - started) / len(task.query)
    return [_count(outcome, mode, torch.stack(scores[mode]), task, per_query) for mode in modes]


def _search(method: Method, task: Task, k: int, device: torch.device | None) -> Hits:
    index = index_for(method)
    index.add(describe_all(method, task.database.rasters, device=device).cpu())
    return index.search(describe_all(method, task.query.rasters, device=device).cpu(), k)


def _planar_poses(side: Side) -> Tensor:
    """x, y and heading in the world of each scan as it was shown to the method: (n, 3)."""
    scans = side.scans
    heading = scans.headings if scans.turns is None else scans.headings - scans.turns
    return torch.from_numpy(np.column_stack([scans.positions, heading]))


def _pose_scores(candidates: Candidates, poses: Tensor, settings: RerankSettings) -> Tensor:
    """(d,) that put the candidates in their new order; the first has its own fit."""
    order = by_pose(candidates, settings)
    scores = torch.full((len(poses),), -1.0)
    scores[candidates.place[order]] = -torch.arange(len(order)) / len(order)
    scores[candidates.place[order[0]]] = candidates.aligned.score[order[0]]
    return scores


def _location_scores(candidates: Candidates, poses: Tensor, settings: RerankSettings) -> Tensor:
    """(d,) that put the places in the order of their distance; the first has the best fit."""
    located = by_location(candidates, poses[candidates.place], settings)
    away = torch.linalg.vector_norm(poses[:, :2] - located.position, dim=-1)
    scores = -away.float()
    scores[away.argmin()] = located.fit
    return scores


_SCORES = {"pose": _pose_scores, "locate": _location_scores}


class _Scored(NamedTuple):
    """Scores (q, d) that are there already, as the protocol asks for them: by row numbers."""

    scores: Tensor

    def compare(self, queries: Tensor, _: Tensor) -> Comparison:
        return Comparison(self.scores[queries], None)


def _count(outcome: Outcome, mode: Rerank, scores: Tensor, task: Task, per_query: float) -> Outcome:
    first = outcome.results[0]
    name = NAMES[mode].format(outcome.method)
    query, database = (
        Described(torch.arange(len(side)), side.scans.positions)
        for side in (task.query, task.database)
    )
    counted = score_sides(
        Labels(name, first.train, first.test, first.region),
        _Scored(scores),  # type: ignore[arg-type]  # only compared
        query,
        database,
        [row.radius_m for row in outcome.results],
        first.seconds_per_scan,
    )
    rows = [replace(row, seconds_per_query=per_query) for row in counted.results]
    return replace(counted, results=rows)
