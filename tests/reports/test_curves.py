"""What stands in the figures that compare methods."""

import numpy as np
import pytest
import torch

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.evaluation.metrics import max_f1, place_auc, place_precision_recall
from deepring.reports.curves import precision_recall_figure, recall_radius_figure
from deepring.reports.style import save
from helpers.results import result_of


def result(method="RING", radius=10.0, recall=0.8, train="", test="nclt", queries=100):
    rates = (recall, recall, recall, recall)
    return result_of(Case(method, train, test, "test"), radius, (50, queries, 50), rates)


def legend(figure):
    owners = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]
    return [text.get_text() for owner in owners if owner for text in owner.get_texts()]


def test_precision_recall_figure_shows_auc_and_f1_of_each_method(tmp_path):
    generator = torch.Generator().manual_seed(0)
    curves, expected = {}, []
    for method in ("RING", "DeepRING"):
        scores = torch.rand(40, 12, generator=generator)
        distances = torch.rand(40, 12, generator=generator) * 40
        curves[method] = place_precision_recall(scores, distances, 10.0)[:2]
        auc, f1 = place_auc(scores, distances, 10.0), max_f1(scores, distances, 10.0)
        expected.append(f"{method}: AUC {auc:.3f}, max F1 {f1:.3f}")
    figure = precision_recall_figure(curves, radius=10.0)
    assert legend(figure) == expected
    assert figure.axes[0].get_title(loc="left") == "Right within 10 m"
    save(figure, tmp_path / "curves.png", dpi=40)


def test_the_curve_begins_at_recall_zero_with_the_first_precision():
    figure = precision_recall_figure({"RING": ([0.5, 0.25], [0.4, 1.0])}, radius=5.0)
    drawn = [line.get_xydata().tolist() for line in figure.axes[0].lines]
    assert [[0.0, 0.5], [0.4, 0.5], [1.0, 0.25]] in drawn
    assert [[0.4, 0.5]] in drawn, "the mark sits at the best F1"


@pytest.mark.parametrize(
    ("curves", "message"),
    [
        ({}, "curves: none, expected"),
        ({"RING": ([0.5], [0.4, 1.0])}, r"curves\['RING'\]: precision \(1,\), recall \(2,\)"),
        ({"RING": (np.zeros(0), np.zeros(0))}, "t >= 1"),
        ({"RING": (0.5, 0.5)}, r"precision \(\)"),
    ],
)
def test_unusable_curves_are_refused(curves, message):
    with pytest.raises(DeepringError, match=message):
        precision_recall_figure(curves, radius=10.0)


def test_recall_radius_figure_draws_one_sorted_line_a_method(tmp_path):
    results = [result(radius=r, recall=r / 40) for r in (25.0, 5.0, 10.0)]
    figure = recall_radius_figure([*results, result("DeepRING", 10.0, 0.9)])
    first, second = figure.axes[0].lines
    assert first.get_xydata().tolist() == [[5.0, 0.125], [10.0, 0.25], [25.0, 0.625]]
    assert second.get_xydata().tolist() == [[10.0, 0.9]]
    assert legend(figure) == ["RING", "DeepRING"]
    save(figure, tmp_path / "radii.png", dpi=40)


def test_recall_radius_figure_over_all_queries():
    line = recall_radius_figure([result(recall=0.8)], over="all").axes[0].lines[0]
    assert line.get_ydata().tolist() == [0.4]


def test_a_method_with_two_trainings_has_two_lines():
    figure = recall_radius_figure(
        [result("DeepRING", train="nclt"), result("DeepRING", train=""), result("RING")]
    )
    assert legend(figure) == ["DeepRING (nclt)", "DeepRING (untrained)", "RING"]


@pytest.mark.parametrize("results", [[], [result(), result(test="mulran")]])
def test_several_test_regions_or_none_are_refused(results):
    with pytest.raises(DeepringError, match="expected exactly one"):
        recall_radius_figure(results)
