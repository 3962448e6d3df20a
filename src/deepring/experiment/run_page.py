"""The page of one run: what it found, its methods side by side, and its queries one by one.

The run may be another's: nothing that its config names is imported, and nothing is written.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from omegaconf import OmegaConf

from deepring.errors import ConfigError, DeepringError, FileError
from deepring.evaluation.case import shortened
from deepring.evaluation.matches import TopMatches, matches_in
from deepring.evaluation.metrics import Over
from deepring.evaluation.recall_curves import RecallCurve, read_recall_curves
from deepring.evaluation.results import RECALLS, Result, read_results
from deepring.experiment.config import Config, check_config
from deepring.experiment.method_views import MethodViews
from deepring.experiment.query_views import QueryPictures, chosen_rows, query_map, splits_of
from deepring.experiment.run_folder import read_config
from deepring.experiment.run_method import run_method
from deepring.experiment.status import read_status
from deepring.methods.method import Method
from deepring.progress import progress_bar
from deepring.rasters import BevRaster
from deepring.reports import html
from deepring.reports.comparison_sections import curves, side_by_side
from deepring.reports.method_results import Kinds, MethodResults, RegionResults
from deepring.reports.query_section import query_sections
from deepring.reports.query_view import QueryMap
from deepring.reports.results_table import (
    bounds_text,
    counted,
    expect_results_at,
    interval_text,
    recall,
    within_text,
)

_HEAD = (
    *("method", "test", "region", "R@1", "R@5", "R@1%"),
    *("max F1", "AUC", "AP", "ms/scan", "ms/query"),
)


def run_page(run: Path, pictures: int, radius: float | None, over: Over | None) -> str:
    """The page; see `deepring.experiment.report.report`."""
    results = read_results(run / "results.csv")
    cfg = read_run_config(run)
    if radius is None:
        radius = first_radius(run, cfg, results)
    expect_results_at(results, radius)
    over = cfg.evaluation.counted_over if over is None else over
    matches = list(matches_in(run))
    regions = regions_of_run(results, matches, read_recall_curves(run), cfg, radius, over)
    kinds = Kinds(regions)
    shown = [result for result in results if math.isclose(result.radius_m, radius)]
    main = main_method(results, cfg)
    within = within_text(regions[0].radius, regions[0].wrong_beyond or regions[0].radius)
    parts = [
        *_headline(regions, main, results, run, cfg),
        html.heading(f"Methods side by side, {within}"),
        *side_by_side(regions, kinds),
        html.heading("Curves"),
        *curves(regions, kinds),
        html.heading("Queries one by one"),
        *_queries(run, cfg, matches, main, regions, pictures),
        html.heading("All figures"),
        html.table(_HEAD, [_row(r, over) for r in shown], ("test", "region")),
        html.details("Config", [html.preformatted(_text(run / "config.yaml"))]),
    ]
    return html.page(f"{cfg.experiment_name}: {run.resolve().name}", parts)


def read_run_config(run: Path) -> Config:
    """The config of a run, checked. Raises FileError for one of another version."""
    path = run / "config.yaml"
    try:
        return check_config(OmegaConf.create(read_config(path)))
    except ConfigError as error:
        raise FileError(
            f"{path}: {error}; expected the config of a run of this version; evaluate it again"
        ) from error


def first_radius(run: Path, cfg: Config, results: Sequence[Result]) -> float:
    """The radius of a run's headline. Raises FileError if the run has no result at it."""
    radius = float(cfg.evaluation.radii[0])
    if not any(math.isclose(result.radius_m, radius) for result in results):
        raise FileError(
            f"{run / 'results.csv'}: no result within {radius:g} m, expected some, since that is "
            "the first of evaluation.radii in config.yaml; evaluate again, or give a radius"
        )
    return radius


def regions_of_run(
    results: Sequence[Result],
    matches: Sequence[TopMatches],
    recalls: Sequence[RecallCurve],
    cfg: Config,
    radius: float,
    over: Over,
) -> list[RegionResults]:
    """The regions of a run in the order of its results, with the methods that were tested there."""
    found = {m.case: m for m in matches}
    places = dict.fromkeys((r.case.test, r.case.region) for r in results)
    regions = []
    for test, region in places:
        of_region = [r for r in results if (r.case.test, r.case.region) == (test, region)]
        methods = [
            MethodResults(
                case.method,
                {cfg.seed: [r for r in of_region if r.case == case]},
                {cfg.seed: found[case]} if case in found else {},
                curves={cfg.seed: of_case}
                if (of_case := [curve for curve in recalls if curve.case == case])
                else {},
            )
            for case in dict.fromkeys(r.case for r in of_region)
        ]
        title, beyond = f"{test} {region}".strip(), cfg.evaluation.wrong_beyond
        regions.append(RegionResults(title, methods, radius, beyond, over))
    return [region for region in regions if region.ranked()]


def main_method(results: Sequence[Result], cfg: Config) -> str:
    """The name of the run's own method: what was trained, else its config's, else the first."""
    trained = [r.case.method for r in results if r.case.train]
    configured = (cfg.method or {}).get("label")
    known = [r.case.method for r in results]
    return trained[0] if trained else configured if configured in known else known[0]


def _headline(
    regions: Sequence[RegionResults], main: str, results: Sequence[Result], run: Path, cfg: Config
) -> Iterator[str]:
    """The recall of the run's method in each region, and how it was made."""
    shown = [
        (region, method, at[cfg.seed])
        for region in regions
        for method in region.methods
        if method.name == main and (at := method.at(region.radius))
    ]
    if shown:
        yield html.lead(_recall_sentence(*shown[0]))
    yield html.soft(_made(main, results, run, cfg))
    if len(shown) > 1:
        yield html.cards(_card(*each) for each in shown)


def _recall_sentence(region: RegionResults, method: MethodResults, result: Result) -> str:
    share, low, high = region.interval(method)
    count = counted(result, region.over)
    which = " that have one" if region.over == "answerable" else ""
    return (
        f"{method.label} finds a place within {region.radius:g} m for {round(share * count)} of "
        f"the {count} queries{which}: Recall@1 {share:.3f}, 95 % interval {low:.3f} to {high:.3f}, "
        f"on {region.title}, {result.queries} queries in {result.database} places."
    )


def _card(region: RegionResults, method: MethodResults, result: Result) -> tuple[str, str]:
    share, low, high = region.interval(method)
    return f"{share:.3f}", (
        f"{bounds_text(low, high)} of {counted(result, region.over)} queries, {region.title}"
    )


def _made(main: str, results: Sequence[Result], run: Path, cfg: Config) -> str:
    """One line on the method and its training."""
    train = next((r.case.train for r in results if r.case.method == main), "")
    status = read_status(run)
    parts = [main]
    if train:
        parts.append(f"trained on {shortened(train.split('+'), ' + ')}")
        if status is not None and status.seconds:
            parts.append(f"for {status.seconds / 60:.1f} min")
        if status is not None and status.score is not None:
            parts.append(f"validation Recall@1 {status.score:.3f}")
    else:
        parts.append("learns nothing")
    return ", ".join([*parts, f"seed {cfg.seed}"]) + "."


def _queries(
    run: Path,
    cfg: Config,
    matches: Sequence[TopMatches],
    main: str,
    regions: Sequence[RegionResults],
    pictures: int,
) -> Iterator[str]:
    """The maps of all regions; without their scans the pictures that the run holds, and why."""
    places = {(m.case.test, m.case.region) for m in matches if m.case.method == main}
    if not places:
        yield html.paragraph(f"The run holds no retrievals of {main} (retrievals/*.csv).")
        yield from _figures(run / "figures")
        return
    try:
        method: Method | None = run_method(run, cfg, main)
    except DeepringError as error:
        yield html.paragraph(f"Without what the method makes of the scans: {error}")
        method = None
    try:
        maps = list(_maps(cfg, matches, main, regions[0].radius, method, pictures // len(places)))
    except DeepringError as error:
        yield html.paragraph(f"Without maps and scans, since these are not available: {error}")
        yield from _figures(run / "figures")
    else:
        yield from query_sections(maps)


def _maps(
    cfg: Config,
    matches: Sequence[TopMatches],
    main: str,
    radius: float,
    method: Method | None,
    pictures: int,
) -> Iterator[QueryMap]:
    for split in splits_of(cfg):
        there = [m for m in matches if (m.case.test, m.case.region) == (split.name, split.region)]
        own = [m for m in there if m.case.method == main]
        if not own:
            continue
        region = query_map(split, there, own[0], radius)
        rows = chosen_rows(region, pictures)
        with progress_bar(f"{region.title}: pictures of queries") as bar:
            views = QueryPictures(split, region, method).views(rows, bar)
        period = 360.0 if method is None else MethodViews(method).period
        yield replace(region, views=views, extent=BevRaster().extent, period=period)


def _figures(folder: Path) -> Iterator[str]:
    """The pictures that the evaluation drew."""
    for file in sorted(folder.rglob("hits*.png")):
        name = file.relative_to(folder).with_suffix("").as_posix().replace("_", " ")
        yield html.picture(file, name)


def _row(r: Result, over: Over) -> tuple[str, ...]:
    recalls = (
        f"{share:.3f} {interval_text(share, counted(r, over))}"
        for share in (recall(r, name, over) for name in RECALLS)
    )
    rates = (f"{value:.3f}" for value in (r.f1_max, r.auc, r.ap))
    times = (f"{1e3 * seconds:.3g}" for seconds in (r.seconds_per_scan, r.seconds_per_query))
    return (r.case.method, r.case.test, r.case.region, *recalls, *rates, *times)


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")
