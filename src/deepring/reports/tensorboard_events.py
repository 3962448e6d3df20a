"""TensorBoard events of an evaluation: metrics, PR curves, figures and descriptors."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from tensorboard.compat.proto.summary_pb2 import Summary
from torch import Tensor
from torch.utils.tensorboard import SummaryWriter

from deepring.evaluation.matches import TopMatches
from deepring.evaluation.protocol import Outcome
from deepring.evaluation.reranked_labels import method_label
from deepring.reports.hparams_events import Value, add_hparams

#: Thresholds that TensorBoard's PR page draws.
THRESHOLDS = 127

#: The metrics of a result, with their names on the pages, those of most interest first.
_METRICS = {
    "recall_1": "recall@1",
    "auc": "auc",
    "f1_max": "f1_max",
    "recall_5": "recall@5",
    "recall_1_percent": "recall@1%",
    "ap": "ap",
}

#: How often events are written to the disk. Ctrl-C while one is handed over to the writer's thread
#: can hide all later ones from it until then, and closing waits for that thread.
FLUSH_SECONDS = 2


class Projection(NamedTuple):
    """Points for the projector."""

    vectors: Tensor
    """(n, axes)."""
    columns: Sequence[str]
    """Names of what is known of a point; the first labels it."""
    labels: list[list[str]]
    """n rows of these."""
    pictures: Tensor | None
    """(n, 1, side, side) float in [0, 1], drawn in place of the points; None for dots."""


def write_events(
    folder: Path,
    outcomes: list[Outcome],
    pictures: Mapping[str, bytes],
    hyperparameters: Mapping[str, Value],
    first: Mapping[str, type],
) -> None:
    """Write metrics, PR curves, pictures and hyperparameters of an evaluation.

    The metrics beside the hyperparameters are those of the method that was trained, or else of the
    first: the others do not depend on them. ``pictures`` are PNG files, by their names.
    ``folder`` is the run's TensorBoard folder; ``first`` is that of `add_hparams`.
    """
    with SummaryWriter(str(folder), flush_secs=FLUSH_SECONDS) as writer:
        for outcome in outcomes:
            head, case = outcome.results[0], outcome.case
            place = f"{case.test}/{case.region}"
            for metric, name in _METRICS.items():
                writer.add_scalar(f"test/{place}/{name}/{case.method}", getattr(head, metric))
            tag = f"test/{place}/{case.method}"
            add_pr_curve(writer, tag, outcome.matches, head.radius_m, head.wrong_beyond_m)
        for name, picture in pictures.items():
            _add_png(writer, picture_tag(name), picture)
        add_hparams(writer, hyperparameters, first, own_figures(outcomes))


def own_figures(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """The figures of a run's own method by name, such as "recall@1, town test".

    Names are the same whatever the method, so that runs of several compare. Those of all tests
    come before those with candidates aligned.
    """
    trained = [outcome for outcome in outcomes if outcome.case.train]
    label = method_label((trained or outcomes)[0].case.method) if outcomes else ""
    own = [o for o in trained or outcomes if method_label(o.case.method) == label]
    further = [outcome.case.method.removeprefix(label) for outcome in own]
    return {
        f"{name}, {outcome.case.place}{beyond}": getattr(outcome.results[0], metric)
        for kind in dict.fromkeys(sorted(further, key=len))
        for metric, name in _METRICS.items()
        for outcome, beyond in zip(own, further, strict=True)
        if beyond == kind
    }


def _add_png(writer: SummaryWriter, tag: str, picture: bytes) -> None:
    """Add a PNG file as it is; ``add_figure`` would draw it anew."""
    width, height = (int.from_bytes(picture[k : k + 4], "big") for k in (16, 20))  # its header
    image = Summary.Image(
        height=height, width=width, colorspace=_RGBA, encoded_image_string=picture
    )
    summary = Summary(value=[Summary.Value(tag=tag, image=image)])
    writer.file_writer.add_summary(summary)  # type: ignore[attr-defined]  # typed as None


#: TensorBoard's number for red, green, blue and opacity.
_RGBA = 4


def picture_tag(name: str) -> str:
    """The tag of a picture, by the name of its file: what stands before its first / is a group.

    >>> picture_tag("hits_RING"), picture_tag("nclt_test/sinogram_0010"), picture_tag("pr_curves")
    ('hits/RING', 'sinograms/nclt_test/0010', 'curves/pr_curves')
    """
    place, slash, own = name.rpartition("/")
    for start, group in _GROUPS.items():
        if own.startswith(start):
            return f"{group}/{place}{slash}{own.removeprefix(start)}"
    return f"curves/{name}"


#: Groups of pictures, by how the names of their files begin; all others are curves.
_GROUPS = {"hits_": "hits", "sinogram_": "sinograms"}


def add_pr_curve(
    writer: SummaryWriter, tag: str, matches: TopMatches, radius: float, wrong_beyond: float
) -> None:
    """Add the protocol's precision and recall at evenly spaced thresholds.

    A best place from ``radius`` to ``wrong_beyond`` metres is neither right nor wrong.
    TensorBoard's own counting would count every wrong place as a missed one.
    """
    score, right = matches.score[:, 0], matches.distance[:, 0] <= radius
    wrong = matches.distance[:, 0] > wrong_beyond
    answerable = matches.nearest <= radius
    thresholds = np.linspace(score.min(), score.max(), THRESHOLDS)
    accepted = score[None] >= thresholds[:, None]
    tp, fp = (accepted & right).sum(1), (accepted & wrong).sum(1)
    fn, tn = (~accepted & answerable).sum(1), (~accepted & ~answerable).sum(1)
    writer.add_pr_curve_raw(
        tag,
        true_positive_counts=torch.from_numpy(tp),
        false_positive_counts=torch.from_numpy(fp),
        true_negative_counts=torch.from_numpy(tn),
        false_negative_counts=torch.from_numpy(fn),
        precision=torch.from_numpy(tp / np.maximum(tp + fp, 1)),
        recall=torch.from_numpy(tp / np.maximum(tp + fn, 1)),
        num_thresholds=THRESHOLDS,
    )


def add_projection(folder: Path, tag: str, projection: Projection) -> None:
    """Add points to the projector, which colours them by any column."""
    with SummaryWriter(str(folder), flush_secs=FLUSH_SECONDS) as writer:
        writer.add_embedding(
            projection.vectors,
            metadata=projection.labels,
            metadata_header=list(projection.columns),
            label_img=projection.pictures,
            tag=tag,
        )
