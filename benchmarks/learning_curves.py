"""Validation recall over minutes of training: would more time help?

    deepring train method=disco_small data=sim_nclt evaluate=false
    python benchmarks/learning_curves.py outputs/train/latest
    python benchmarks/learning_curves.py outputs/sweeps/NAME --output curves.svg

Reads the TensorBoard events of runs, also of those that are not finished; a folder stands for all
runs below it. Minutes are those between a run's events, validation included, without the pauses
between an interrupted run and its resumption. "Rise" is the mean recall of the last quarter of the
validations less that of the quarter before: with less than the standard error of a validation
(``--queries`` gives the number of its queries), more time would hardly help.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from deepring.experiment.run_folder import read_config
from deepring.io.files import replacing
from deepring.reports.style import legend_below, new_figure, series, style_axes, without_formulas

TAG = "val/recall@1"


@dataclass(frozen=True)
class Curve:
    """Validation recall of a run."""

    name: str
    method: str
    minutes: NDArray[np.float64]
    """(n,) of training before each validation."""
    recall: NDArray[np.float64]
    """(n,) Recall@1, the mean over the run's validation sets."""

    def at(self, share: float) -> float:
        """The best recall in this share of the training time."""
        return float(self.recall[self.minutes <= share * self.minutes[-1] + 1e-9].max(initial=0.0))

    @property
    def rise(self) -> float:
        """Mean recall of the last quarter less that of the quarter before; NaN below 4."""
        quarter = len(self.recall) // 4
        if not quarter:
            return math.nan
        return float(self.recall[-quarter:].mean() - self.recall[-2 * quarter : -quarter].mean())


def run_folders(paths: Sequence[Path]) -> list[Path]:
    """Folders with events, in the paths or below them, each once."""
    events = [folder for path in paths for folder in sorted(path.rglob("tensorboard"))]
    return list(dict.fromkeys(folder.parent.resolve() for folder in events))


def curve_of(folder: Path) -> Curve | None:
    """The curve of a run folder; None where no validation was logged."""
    minutes, recall, before = [], [], 0.0
    for file in sorted((folder / "tensorboard").glob("events.*"), key=_started):
        events = EventAccumulator(str(file)).Reload()
        if TAG not in events.Tags()["scalars"]:  # an evaluation's
            continue
        start = events.FirstEventTimestamp()
        for event in events.Scalars(TAG):
            minutes.append(before + (event.wall_time - start) / 60)
            recall.append(event.value)
        before = minutes[-1]
    if not recall:
        return None
    target = str((read_config(folder / "config.yaml").get("method") or {}).get("_target_", ""))
    name = f"{folder.parent.name}/{folder.name}"
    return Curve(name, target.rpartition(".")[2], np.array(minutes), np.array(recall))


def _started(file: Path) -> float:
    return EventAccumulator(str(file)).Reload().FirstEventTimestamp()


def lines(curves: Sequence[Curve], queries: int | None) -> Iterator[str]:
    """A Markdown table, one row per run."""
    shares = (0.25, 0.5, 0.75, 1.0)
    head = " | ".join(f"best in {share:.0%}" for share in shares)
    yield f"| run | method | minutes | validations | {head} | rise |"
    yield f"| --- | --- |{' ---: |' * (3 + len(shares))}"
    for curve in curves:
        best = " | ".join(f"{curve.at(share):.3f}" for share in shares)
        error = ""
        if queries is not None:
            at = curve.at(1.0)
            error = f" ± {math.sqrt(at * (1 - at) / queries):.3f}"
        row = f"| {curve.name} | {curve.method} | {curve.minutes[-1]:.1f} | {len(curve.recall)}"
        yield f"{row} | {best} | {curve.rise:+.3f}{error} |"


def figure_of(curves: Sequence[Curve], title: str) -> Figure:
    """Recall over minutes, one line per run, the best so far over the faint single values."""
    figure = new_figure(7.2, 4.4 + 0.2 * math.ceil(len(curves) / 2))
    axes = figure.add_subplot()
    for index, curve in enumerate(curves):
        colour, line, _ = series(index)
        axes.plot(curve.minutes, curve.recall, ".", color=colour, alpha=0.35, markersize=5)
        best = np.maximum.accumulate(curve.recall)
        label = f"{curve.method}, {curve.name}"
        axes.plot(curve.minutes, best, line, color=colour, label=label, drawstyle="steps-post")
    style_axes(axes, title, "minutes of training", "validation Recall@1")
    axes.set_ylim(0, 1.02)
    axes.set_xlim(left=0)
    legend_below(figure, 1, handlelength=1.6)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", nargs="+", type=Path, help="run folders, or folders of them")
    parser.add_argument("--output", type=Path, help="figure to write, .svg, .png or .pdf")
    parser.add_argument("--title", default="Learning curves")
    parser.add_argument("--queries", type=int, help="validation queries, for the standard error")
    arguments = parser.parse_args()
    folders = run_folders(arguments.runs)
    curves = [curve for folder in folders if (curve := curve_of(folder)) is not None]
    if not curves:
        raise SystemExit(f"no run with validations in {', '.join(map(str, arguments.runs))}")
    print("\n".join(lines(curves, arguments.queries)))
    if arguments.output is not None:
        with replacing(arguments.output) as temporary:
            kind = arguments.output.suffix.removeprefix(".")
            without_formulas(figure_of(curves, arguments.title)).savefig(temporary, format=kind)


if __name__ == "__main__":
    main()
