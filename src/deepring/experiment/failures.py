"""The part of a report about wrong answers: the worst ones of the network, with their scans."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from deepring.core.correlation import correlation_curves
from deepring.data.dataset import RetrievalSet
from deepring.data.scan_set import ScanSet
from deepring.errors import BrokenScanError, DataError, DeepringError
from deepring.evaluation.matches import TopMatches, matches_in
from deepring.evaluation.task import rows_of
from deepring.experiment import build
from deepring.experiment.config import Config
from deepring.experiment.pictures import period_of
from deepring.experiment.plan import regions_of
from deepring.methods.deepring import DeepRing
from deepring.methods.network_file import SHIPPED, load_network
from deepring.rasters import BevRaster
from deepring.reports import html
from deepring.reports.failures import ScanView, failure_figure


def failure_parts(run: Path, cfg: Config, radius: float, count: int) -> Iterator[str]:
    """Figures of the ``count`` wrong answers with the highest scores, on each split, as HTML.

    The network is that of the run's checkpoint, if its method is registered: the config's classes
    are not imported. Scans are read from where the config says, and no cache is made.
    """
    checkpoints = [run / "checkpoints" / name for name in ("best.ckpt", "last.ckpt")]
    configured = [] if cfg.checkpoint is None else [Path(cfg.checkpoint)]
    present = (c for c in (*configured, *checkpoints) if c.is_file() or str(c) == SHIPPED)
    checkpoint = next(present, None)
    if checkpoint is None:
        yield html.paragraph("The run holds no checkpoint: failures are drawn only for networks.")
        return
    try:
        network = load_network(checkpoint).method
    except DeepringError as error:
        yield html.paragraph(f"Not drawn, since the network cannot be read: {error}")
        return
    if not isinstance(network, DeepRing) or not isinstance(network.raster, BevRaster):
        yield html.paragraph("Failures are drawn only for DeepRING over bird's-eye views.")
        return
    matches = {(m.case.method, m.case.test, m.case.region): m for m in matches_in(run)}
    try:
        for split in _splits(cfg):
            of_split = matches.get((network.settings.label, split.name, split.region))
            if of_split is not None:
                yield from _of_split(network, split, of_split, radius, count)
    except DeepringError as error:
        yield html.paragraph(f"Not drawn, since the scans are not available: {error}")


def _splits(cfg: Config) -> Iterator[RetrievalSet]:
    _, tests = build.datasets(cfg)
    for dataset in tests:
        for region in regions_of(cfg.evaluation, dataset):
            yield dataset.retrieval(region)


def _of_split(
    network: DeepRing, split: RetrievalSet, matches: TopMatches, radius: float, count: int
) -> Iterator[str]:
    answerable = matches.nearest <= radius
    wrong = np.flatnonzero((matches.distance[:, 0] > radius) & answerable)
    yield html.paragraph(
        f"{split.name}, {split.region}: {len(wrong)} of {answerable.sum()} answerable queries "
        f"are wrong; shown are the {min(count, len(wrong))} of the highest scores."
    )
    for row in wrong[np.argsort(-matches.score[wrong, 0], kind="stable")][:count]:
        yield _figure(network, split, matches, int(row))


def _figure(network: DeepRing, split: RetrievalSet, matches: TopMatches, row: int) -> str:
    """The query at a row of the matches, with its best and its nearest place."""
    raster, database = network.raster, split.database
    assert isinstance(raster, BevRaster)
    query = int(rows_of(split.query, matches.query[row : row + 1])[0])
    place = int(rows_of(database, matches.place[row, :1])[0])
    away = np.linalg.norm(database.positions - split.query.positions[query], axis=1)
    searched = split.searched
    among = away if searched is None else away[: searched[query]]
    nearest, nearest_image = _nearest(database, np.argsort(among, kind="stable"), raster)
    images = [
        ("query", _image(split.query, query, raster)),
        (f"retrieved, {away[place]:.0f} m", _image(database, place, raster)),
        (f"nearest, {away[nearest]:.0f} m", nearest_image),
    ]
    caption = (
        f"Scan {matches.query[row]}: score {matches.score[row, 0]:.3f}, retrieved scan "
        f"{matches.place[row, 0]}, {away[place]:.0f} m away; the nearest place is "
        f"{away[nearest]:.0f} m away"
    )
    figure = failure_figure(_views(network, images), raster.extent, period_of(network))
    return html.picture(figure, caption)


def _nearest(scans: ScanSet, order: np.ndarray, raster: BevRaster) -> tuple[int, Tensor]:
    """The first scan of the order that can be used, as the evaluation saw them, and its image."""
    for k in order.tolist():
        try:
            return k, _image(scans, k, raster)
        except BrokenScanError:
            continue
    raise DataError(f"scans of {scans.session.name}: none can be read, expected at least one")


def _image(scans: ScanSet, k: int, raster: BevRaster) -> Tensor:
    return torch.from_numpy(scans.rasterize(k, raster))[None]


def _views(network: DeepRing, images: list[tuple[str, Tensor]]) -> list[ScanView]:
    """Views of the images (1, n, n) by the network: the query first, then places."""
    query = network.describe(images[0][1])
    views = []
    for number, (title, image) in enumerate(images):
        curve = correlation_curves(query, network.describe(image))[0, 0].numpy()
        sinogram = network.representation(image)[0, 0].numpy()
        bev = image[0].bool().numpy()
        views.append(ScanView(title, bev, sinogram, curve if number else None))
    return views
