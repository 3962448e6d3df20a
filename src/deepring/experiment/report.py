"""A run as one page: results, maps, curves, and the worst failures with their scans.

The run may be another's: nothing that its config names is imported, and nothing is written.
"""

from collections.abc import Iterator
from pathlib import Path

from omegaconf import OmegaConf

from deepring.errors import ConfigError, FileError
from deepring.evaluation.results import RECALLS, Result, read_results
from deepring.experiment.config import Config, check_config
from deepring.experiment.failures import failure_parts
from deepring.experiment.run_folder import read_config
from deepring.reports import html
from deepring.reports.results_table import interval_text, within_text

#: Captions of the figures, in their order on the page, by the beginning of their files' names.
FIGURES = {
    "hits": "Where the best place was right and where it was not",
    "pr_curves": "Precision and recall as the threshold of the score falls",
    "recall_by_radius": "Recall@1 by the radius within which a place counts as right",
    "sinogram": "A scan, its sinogram, the sinogram of a turned twin, and their correlation",
}

_HEAD = (
    *("method", "test", "region", "R@1", "R@5", "R@1%"),
    *("max F1", "AUC", "AP", "ms/scan", "ms/query"),
)


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
        html.heading(f"Results, {within_text(radius, cfg.evaluation.wrong_beyond or radius)}"),
        html.table(_HEAD, [_row(r) for r in results if r.radius_m == radius]),
        *_pictures(run / "figures"),
        html.heading("The worst failures"),
        *failure_parts(run, cfg, radius, failures),
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
    recalls = (
        f"{getattr(r, name):.3f} {interval_text(getattr(r, name), r.answerable)}"
        for name in RECALLS
    )
    rates = (f"{value:.3f}" for value in (r.f1_max, r.auc, r.ap))
    times = (f"{1e3 * seconds:.3g}" for seconds in (r.seconds_per_scan, r.seconds_per_query))
    return (r.case.method, r.case.test, r.case.region, *recalls, *rates, *times)


def _pictures(folder: Path) -> Iterator[str]:
    for beginning, caption in FIGURES.items():
        files = sorted(folder.rglob(f"{beginning}*.png"))
        if files:
            yield html.heading(caption)
        for file in files:
            name = file.relative_to(folder).with_suffix("").as_posix().replace("_", " ")
            yield html.picture(file, name)
