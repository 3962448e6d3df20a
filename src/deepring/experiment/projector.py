"""What TensorBoard's projector shows: descriptors of the map and of the queries, with pictures."""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from deepring.core.correlation import theta_spectrum
from deepring.data.packed_rasters import Rasters
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.task import RetrievalTask
from deepring.methods.deepring import DeepRing
from deepring.methods.method import describe_all
from deepring.methods.network import NetworkMethod
from deepring.rasters import BevRaster
from deepring.reports.tensorboard_events import Projection, add_projection

#: Scans of either side, evenly spread, that the page can still turn smoothly.
_SCANS = 1000

#: Axes that are kept, those of the largest variance.
_AXES = 64

#: Pixels along a side of a scan's picture.
_PICTURE = 32

_COLUMNS = ("scan", "answer", "x", "y")


def project(
    events: Path, network: NetworkMethod, task: RetrievalTask, matches: TopMatches, radius: float
) -> None:
    """Write the descriptors of a task's map and queries for the projector.

    Args:
        events: the run's TensorBoard folder.
        network: on the CPU.
        task: the map and the queries.
        matches: what was found for each query.
        radius: metres within which a best place is right.
    """
    answers = _answers(matches, radius)
    parts = []
    for kind, scans, rasters in (
        ("map", task.scans.database, task.database),
        ("query", task.scans.query, task.query),
    ):
        rows = np.unique(np.linspace(0, len(rasters) - 1, _SCANS).round().astype(int))
        some = Rasters(rasters.data[rows], rasters.raster)
        numbers = scans.indices[rows]
        places = scans.ground_truth[rows].round(1).astype(str)
        labels = [
            [f"{kind} {number}", answers.get(number, "-") if kind == "query" else kind, *place]
            for number, place in zip(numbers.tolist(), places.tolist(), strict=True)
        ]
        parts.append((_invariant(network, some), labels, _pictures(some)))
    vectors = torch.cat([part[0] for part in parts])
    pictures = [part[2] for part in parts if part[2] is not None]
    projection = Projection(
        _main_axes(vectors),
        _COLUMNS,
        [row for part in parts for row in part[1]],
        torch.cat(pictures) if pictures else None,
    )
    add_projection(events, f"descriptors/{matches.case.test}_{matches.case.region}", projection)


def _answers(matches: TopMatches, radius: float) -> dict[int, str]:
    """What was found for each query, by the number of its scan."""
    right, answerable = matches.distance[:, 0] <= radius, matches.nearest <= radius
    words = np.where(answerable, np.where(right, "hit", "miss"), "no place in reach")
    return dict(zip(matches.query.tolist(), words.tolist(), strict=True))


def _invariant(network: NetworkMethod, rasters: Rasters) -> Float[Tensor, "n value"]:
    """Vectors of the scans, of a DeepRING without what a turn changes: its spectrum's phases."""
    descriptors = describe_all(network, rasters)
    if isinstance(network, DeepRing):
        descriptors = theta_spectrum(descriptors).abs()
    else:
        descriptors = network.vectors(descriptors)
    return descriptors.flatten(1).float()


def _main_axes(vectors: Float[Tensor, "n value"]) -> Float[Tensor, "n axis"]:
    """The vectors along the axes of their largest variance, centred."""
    if vectors.shape[1] <= _AXES:
        return vectors
    left, size, _ = torch.linalg.svd(vectors - vectors.mean(dim=0), full_matrices=False)
    return left[:, :_AXES] * size[:_AXES]


def _pictures(rasters: Rasters) -> Float[Tensor, "n 1 side side"] | None:
    """Small pictures of scans from above, black on white; None for other rasters."""
    if not isinstance(rasters.raster, BevRaster):
        return None
    occupied = rasters[slice(None)].float()[:, None]
    return 1 - functional.adaptive_max_pool2d(occupied, _PICTURE)
