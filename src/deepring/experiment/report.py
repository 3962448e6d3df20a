"""A run as one page to look at: results, maps, curves, and the worst failures with their scans."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from omegaconf import OmegaConf

from deepring.core.correlation import correlation_curves
from deepring.data.cache import RasterCache, Rasters, ScanSet
from deepring.data.dataset import RetrievalSet
from deepring.errors import DeepringError
from deepring.evaluation.results import Result, read_results
from deepring.evaluation.retrievals import Retrievals, retrievals_in
from deepring.experiment.config import Config, check_config
from deepring.experiment.evaluate import load_task
from deepring.experiment.pictures import period_of
from deepring.experiment.plan import plan_evaluation
from deepring.experiment.run_folder import read_config
from deepring.methods.deepring import DeepRing
from deepring.methods.network_file import SHIPPED
from deepring.rasters.kinds import BevRaster
from deepring.reports import html
from deepring.reports.failures import Shown, failure_figure

#: Figures by the beginning of their files' names, in the order they are shown, with captions.
FIGURES = {
    "hits": "Where the best place was right and where it was not",
    "pr_curves": "Precision and recall as the threshold of the score falls",
    "recall_by_radius": "Recall@1 by the radius within which a place counts as right",
    "sinogram": "A scan, its sinogram, the sinogram of a turned twin, and their correlation",
}

_HEAD = ("method", "test", "region", "R@1", "R@5", "max F1", "AUC", "ms/scan", "ms/query")


def report(run: Path, failures: int = 6) -> str:
    """The page of an evaluated run. Raises DeepringError where it is none.

    Failures are those of a trained DeepRING; they need the scans that it was tested on.
    """
    if not (run / "results.csv").is_file():
        raise DeepringError(
            f"{run}: no results.csv in it; expected the folder of a run that was evaluated, such "
            "as outputs/demo/latest"
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
        html.preformatted((run / "config.yaml").read_text()),
    ]
    return html.page(f"{cfg.experiment_name}: {run.resolve().name}", parts)


def _config(run: Path) -> Config:
    return check_config(OmegaConf.create(read_config(run / "config.yaml")))


def _row(r: Result) -> tuple[str, ...]:
    rates = (f"{value:.3f}" for value in (r.recall_1, r.recall_5, r.f1_max, r.auc))
    times = (f"{1e3 * seconds:.3g}" for seconds in (r.seconds_per_scan, r.seconds_per_query))
    return (r.method, r.test, r.region, *rates, *times)


def _pictures(folder: Path) -> Iterator[str]:
    for beginning, caption in FIGURES.items():
        files = sorted(folder.rglob(f"{beginning}*.png"))
        if files:
            yield html.heading(caption)
        for file in files:
            name = file.relative_to(folder).with_suffix("").as_posix().replace("_", " ")
            yield html.picture(file, name)


def _failures(run: Path, cfg: Config, radius: float, count: int) -> Iterator[str]:
    """The wrong answers of the highest scores, drawn."""
    checkpoints = [run / "checkpoints" / name for name in ("best.ckpt", "last.ckpt")]
    given = [] if cfg.checkpoint is None else [Path(cfg.checkpoint)]
    there = (c for c in (*given, *checkpoints) if c.is_file() or str(c) == SHIPPED)
    checkpoint = next(there, None)
    if checkpoint is None:
        yield html.paragraph("No checkpoint lies in the run: failures are drawn of networks alone.")
        return
    try:
        plan = plan_evaluation(cfg, checkpoint)
    except DeepringError as error:
        yield html.paragraph(f"Not drawn, since the scans are not at hand: {error}")
        return
    network = plan.network
    if not isinstance(network, DeepRing) or not isinstance(network.raster, BevRaster):
        yield html.paragraph("Drawn for DeepRING over images from above alone.")
        return
    network.cpu()
    kept = {(r.method, r.test, r.region): r for r in retrievals_in(run)}
    for split in plan.splits:
        found = kept.get((network.settings.label, split.name, split.region))
        if found is None:
            continue
        wrong = np.flatnonzero((found.distance > radius) & (found.nearest <= radius))
        answerable = int((found.nearest <= radius).sum())
        yield html.paragraph(
            f"{split.name}, {split.region}: {len(wrong)} of {answerable} answerable queries are "
            f"wrong; shown are the {min(count, len(wrong))} of the highest scores."
        )
        worst = wrong[np.argsort(-found.score[wrong], kind="stable")][:count]
        yield from _drawn(plan.cache, network, split, found, worst)


def _drawn(
    cache: RasterCache, network: DeepRing, split: RetrievalSet, found: Retrievals, worst: np.ndarray
) -> Iterator[str]:
    task = load_task(cache, split, network.raster)
    for q in worst:
        query = _numbered(task.query.scans, int(found.query[q]))
        place = _numbered(task.database.scans, int(found.place[q]))
        position = task.query.scans.positions[query]
        away = np.linalg.norm(task.database.scans.positions - position, axis=1)
        right = int(away.argmin())
        seen = [
            ("query", _one(task.query.rasters, query)),
            (f"retrieved, {away[place]:.0f} m", _one(task.database.rasters, place)),
            (f"nearest, {away[right]:.0f} m", _one(task.database.rasters, right)),
        ]
        shown = _shown(network, seen)
        period = period_of(network)
        assert isinstance(network.raster, BevRaster)
        figure = failure_figure(shown, network.raster.extent, period)
        caption = (
            f"Scan {found.query[q]}: score {found.score[q]:.3f}, retrieved scan "
            f"{found.place[q]}, {away[place]:.0f} m away; the nearest place is "
            f"{away[right]:.0f} m away"
        )
        yield html.picture(figure, caption)


def _numbered(scans: ScanSet, index: int) -> int:
    """Which of the set's scans has this number in its session."""
    return int(np.flatnonzero(scans.indices == index)[0])


def _one(rasters: Rasters, k: int) -> torch.Tensor:
    return rasters[k : k + 1]


def _shown(network: DeepRing, seen: list[tuple[str, torch.Tensor]]) -> list[Shown]:
    descriptors = [network.describe(image) for _, image in seen]
    shown = []
    for (title, image), descriptor in zip(seen, descriptors, strict=True):
        curve = correlation_curves(descriptors[0], descriptor)[0, 0].numpy()
        sinogram = network.representation(image)[0, 0].numpy()
        own = descriptor is descriptors[0]
        shown.append(Shown(title, image[0].bool().numpy(), sinogram, None if own else curve))
    return shown
