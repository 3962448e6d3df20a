"""A run as one page: results, maps, curves, and the worst failures with their scans."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from omegaconf import OmegaConf

from deepring.core.correlation import correlation_curves
from deepring.data.cache import RasterCache
from deepring.data.dataset import RetrievalSet
from deepring.errors import ConfigError, DeepringError, FileError
from deepring.evaluation.matches import TopMatches, matches_in
from deepring.evaluation.results import Result, read_results
from deepring.evaluation.task import load_task, rows_of
from deepring.experiment.config import Config, check_config
from deepring.experiment.pictures import period_of
from deepring.experiment.plan import plan_evaluation
from deepring.experiment.run_folder import read_config
from deepring.methods.deepring import DeepRing
from deepring.methods.network_file import SHIPPED
from deepring.rasters import BevRaster
from deepring.reports import html
from deepring.reports.failures import ScanView, failure_figure

#: Captions of the figures, in their order on the page, by the beginning of their files' names.
FIGURES = {
    "hits": "Where the best place was right and where it was not",
    "pr_curves": "Precision and recall as the threshold of the score falls",
    "recall_by_radius": "Recall@1 by the radius within which a place counts as right",
    "sinogram": "A scan, its sinogram, the sinogram of a turned twin, and their correlation",
}

_HEAD = ("method", "test", "region", "R@1", "R@5", "max F1", "AUC", "ms/scan", "ms/query")


def report(run: Path, failures: int = 6) -> str:
    """The page of an evaluated run. Raises DeepringError if ``run`` is not the folder of one.

    Failures are shown for a trained DeepRING; they need the scans that it was tested on.
    """
    if not (run / "results.csv").is_file():
        raise FileError(
            f"{run}: no results.csv in it; expected the folder of an evaluated run, such as "
            "outputs/demo/latest"
        )
    results = read_results(run / "results.csv")
    cfg = _config(run)
    radius = float(cfg.evaluation.radii[0])
    parts = [
        html.heading(f"Results, right within {radius:g} m"),
        html.table(_HEAD, [_row(r) for r in results if r.radius_m == radius]),
        *_pictures(run / "figures"),
        html.heading("The worst failures"),
        *_failures(run, cfg, radius, failures),
        html.heading("Config"),
        html.preformatted((run / "config.yaml").read_text(encoding="utf-8")),
    ]
    return html.page(f"{cfg.experiment_name}: {run.resolve().name}", parts)


def _config(run: Path) -> Config:
    path = run / "config.yaml"
    try:
        return check_config(OmegaConf.create(read_config(path)))
    except ConfigError as error:
        raise FileError(
            f"{path}: {error}; expected the config of a run of this version; evaluate it again"
        ) from error


def _row(r: Result) -> tuple[str, ...]:
    rates = (f"{value:.3f}" for value in (r.recall_1, r.recall_5, r.f1_max, r.auc))
    times = (f"{1e3 * seconds:.3g}" for seconds in (r.seconds_per_scan, r.seconds_per_query))
    return (r.case.method, r.case.test, r.case.region, *rates, *times)


def _pictures(folder: Path) -> Iterator[str]:
    for beginning, caption in FIGURES.items():
        files = sorted(folder.rglob(f"{beginning}*.png"))
        if files:
            yield html.heading(caption)
        for file in files:
            name = file.relative_to(folder).with_suffix("").as_posix().replace("_", " ")
            yield html.picture(file, name)


def _failures(run: Path, cfg: Config, radius: float, count: int) -> Iterator[str]:
    """Figures of the wrong answers with the highest scores."""
    checkpoints = [run / "checkpoints" / name for name in ("best.ckpt", "last.ckpt")]
    configured = [] if cfg.checkpoint is None else [Path(cfg.checkpoint)]
    present = (c for c in (*configured, *checkpoints) if c.is_file() or str(c) == SHIPPED)
    checkpoint = next(present, None)
    if checkpoint is None:
        yield html.paragraph("The run holds no checkpoint: failures are drawn only for networks.")
        return
    try:
        plan = plan_evaluation(cfg, checkpoint)
    except DeepringError as error:
        yield html.paragraph(f"Not drawn, since the scans are not available: {error}")
        return
    network = plan.network
    if not isinstance(network, DeepRing) or not isinstance(network.raster, BevRaster):
        yield html.paragraph("Failures are drawn only for DeepRING over bird's-eye views.")
        return
    network.cpu()
    by_case = {(m.case.method, m.case.test, m.case.region): m for m in matches_in(run)}
    for split in plan.splits:
        matches = by_case.get((network.settings.label, split.name, split.region))
        if matches is None:
            continue
        answerable = matches.nearest <= radius
        wrong = np.flatnonzero((matches.distance[:, 0] > radius) & answerable)
        yield html.paragraph(
            f"{split.name}, {split.region}: {len(wrong)} of {answerable.sum()} answerable queries "
            f"are wrong; shown are the {min(count, len(wrong))} of the highest scores."
        )
        worst = wrong[np.argsort(-matches.score[wrong, 0], kind="stable")][:count]
        yield from _failure_figures(plan.cache, network, split, matches, worst)


def _failure_figures(
    cache: RasterCache,
    network: DeepRing,
    split: RetrievalSet,
    matches: TopMatches,
    worst: np.ndarray,
) -> Iterator[str]:
    """The queries at rows ``worst`` of the matches, each with its best and its nearest place."""
    raster = network.raster
    assert isinstance(raster, BevRaster)
    task = load_task(cache, split, raster)
    queries, database = task.scans.query, task.scans.database
    for number, best, score in zip(
        matches.query[worst], matches.place[worst, 0], matches.score[worst, 0], strict=True
    ):
        query, place = rows_of(queries, number), rows_of(database, best)
        away = np.linalg.norm(database.positions - queries.positions[query], axis=1)
        right = int(away.argmin())
        images = [
            ("query", task.query[query : query + 1]),
            (f"retrieved, {away[place]:.0f} m", task.database[place : place + 1]),
            (f"nearest, {away[right]:.0f} m", task.database[right : right + 1]),
        ]
        caption = (
            f"Scan {number}: score {score:.3f}, retrieved scan {best}, {away[place]:.0f} m away; "
            f"the nearest place is {away[right]:.0f} m away"
        )
        yield html.picture(
            failure_figure(_views(network, images), raster.extent, period_of(network)), caption
        )


def _views(network: DeepRing, images: list[tuple[str, torch.Tensor]]) -> list[ScanView]:
    """Views of the images (1, n, n) by the network: the query first, then places."""
    query = network.describe(images[0][1])
    views = []
    for number, (title, image) in enumerate(images):
        curve = correlation_curves(query, network.describe(image))[0, 0].numpy()
        sinogram = network.representation(image)[0, 0].numpy()
        bev = image[0].bool().numpy()
        views.append(ScanView(title, bev, sinogram, curve if number else None))
    return views
