"""Figures of an evaluation, for PNG files and TensorBoard."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from torch import Tensor

from deepring.core.correlation import correlation_curves
from deepring.core.radon import radon
from deepring.core.rigid import turn_points
from deepring.data.dataset import RetrievalSet
from deepring.data.scan_set import ScanSet
from deepring.evaluation.counting import precision_recall
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.metrics import Over
from deepring.evaluation.protocol import Outcome
from deepring.evaluation.task import rows_of
from deepring.methods.deepring import DeepRing
from deepring.methods.method import Method
from deepring.methods.network import NetworkMethod
from deepring.methods.ring import Ring
from deepring.rasters import BevRaster
from deepring.reports.curves import precision_recall_figure, recall_radius_figure
from deepring.reports.results_table import within_text
from deepring.reports.sinograms import sinogram_figure
from deepring.reports.trajectory_figure import trajectory_figure

#: The turn of the twin in the sinogram pictures, degrees; no multiple of a θ step.
TWIN_TURN = 100.0


def evaluation_figures(
    outcomes: Sequence[Outcome],
    scans: RetrievalSet,
    network: NetworkMethod | None,
    over: Over,
) -> dict[str, Figure]:
    """PR curves, recall against radius, one map of hits per method, and sample sinograms.

    All methods were evaluated on ``scans``.
    """
    head = outcomes[0].results[0]
    radius, beyond = head.radius_m, head.wrong_beyond_m
    rows = [row for outcome in outcomes for row in outcome.results]
    curves = {o.case.method: precision_recall(o.matches, radius, beyond)[:2] for o in outcomes}
    figures = {
        "pr_curves": precision_recall_figure(
            curves, radius, within_text(radius, beyond).capitalize()
        ),
        "recall_by_radius": recall_radius_figure(rows, over),
    }
    for outcome in outcomes:
        name = f"hits_{outcome.case.method.replace(' ', '_')}"
        figures[name] = hits_figure(outcome.matches, scans, radius)
    sees_bev = network is not None and isinstance(network.raster, BevRaster)
    method: Method = network if network is not None and sees_bev else Ring()
    readable = rows_of(scans.query, outcomes[0].matches.query)
    for number in np.linspace(0, len(readable) - 1, 3).astype(int):
        figures[f"sinogram_{number:04d}"] = twin_figure(method, scans.query, int(readable[number]))
    return figures


def hits_figure(matches: TopMatches, scans: RetrievalSet, radius: float) -> Figure:
    """A map of the queries: whether the best place lies within the radius (metres)."""
    axes = scans.query.session.axes
    north_up = -1 if axes[0] == "north" else 1
    across, up = axes[::north_up]
    case = matches.case
    return trajectory_figure(
        scans.database.ground_truth[:, ::north_up],
        scans.query.ground_truth[rows_of(scans.query, matches.query), ::north_up],
        matches.distance[:, 0] <= radius,
        matches.nearest <= radius,
        f"{case.method}: top-1 within {radius:g} m, {case.place} region",
        (across, up),
    )


def twin_figure(method: Method, scans: ScanSet, k: int) -> Figure:
    """Scan ``k`` and its turned twin: BEV, both sinograms, and the correlation of descriptors."""
    raster = method.raster
    assert isinstance(raster, BevRaster)
    points = scans.session.points(int(scans.indices[k]))
    turned = turn_points(points, math.radians(TWIN_TURN))
    bev, twin = (torch.from_numpy(raster(p, scans.ground_z))[None] for p in (points, turned))
    a, b = method.describe(bev).cpu(), method.describe(twin).cpu()

    def sinogram(image: Tensor) -> NDArray[np.float32]:
        """The sinogram of the method, with as many rows as the descriptor."""
        if isinstance(method, DeepRing):
            return method.representation(image)[0, 0].numpy()
        return radon(image, a.shape[-2], extent=raster.extent)[0].numpy()

    norm = torch.linalg.vector_norm(a) * torch.linalg.vector_norm(b)
    curve = correlation_curves(b, a)[0, 0] / norm
    return sinogram_figure(
        bev[0].numpy(),
        sinogram(bev),
        sinogram(twin),
        curve.numpy(),
        raster.extent,
        TWIN_TURN,
        period_of(method),
    )


def period_of(method: Method) -> float:
    """Degrees after which the sinograms of the method repeat."""
    half = isinstance(method, DeepRing) and method.settings.representation.theta_range == "half"
    return 180.0 if half else 360.0
