"""Metrics against a slow reference, decision by decision, and against their usual misreadings."""

import doctest
import math
import pickle
import statistics
from functools import partial

import numpy as np
import pytest
import torch
import torchmetrics
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from packaging.version import Version
from torchmetrics import MetricCollection
from torchmetrics.classification import BinaryPrecisionRecallCurve
from torchmetrics.retrieval import RetrievalRecall

from deepring.errors import DeepringError
from deepring.evaluation import batched_metrics, case, metrics
from deepring.evaluation.batched_metrics import MaxF1, PlaceAUC, PlacePrecisionRecall, RecallAtK
from deepring.evaluation.metrics import (
    area_under,
    f1_along,
    first_right,
    first_right_among,
    max_f1,
    place_auc,
    place_precision_recall,
    recall_at_k,
)

RADIUS = 10.0


def reference_recall(scores, distances, k, radius, over):
    """Recall@K as the protocol words it."""
    found = answerable = 0
    for score, distance in zip(scores, distances, strict=True):
        best_first = sorted(range(len(score)), key=lambda place: (-score[place], place))
        if any(d <= radius for d in distance):
            answerable += 1
            found += any(distance[place] <= radius for place in best_first[:k])
    return found / (answerable if over == "answerable" else len(scores))


def reference_curve(scores, distances, radius):
    """One decision a query and threshold, counted one by one."""
    tops = [max(score) for score in scores]
    precision, recall, thresholds = [], [], sorted(set(tops), reverse=True)
    for threshold in thresholds:
        tp = fp = fn = 0
        for score, distance in zip(scores, distances, strict=True):
            top = list(score).index(max(score))
            if score[top] >= threshold:
                tp += distance[top] <= radius
                fp += distance[top] > radius
            else:
                fn += any(d <= radius for d in distance)
        precision.append(tp / (tp + fp))
        recall.append(tp / (tp + fn) if tp else 0.0)
    return precision, recall, thresholds


def reference_f1(scores, distances, radius):
    precision, recall, _ = reference_curve(scores, distances, radius)
    return max(
        2 * p * r / (p + r) if p + r else 0.0 for p, r in zip(precision, recall, strict=True)
    )


def reference_auc(scores, distances, radius):
    precision, recall, _ = reference_curve(scores, distances, radius)
    area, p0, r0 = 0.0, precision[0], 0.0
    for p, r in zip(precision, recall, strict=True):
        area += (r - r0) * (p + p0) / 2
        p0, r0 = p, r
    return area


@st.composite
def retrievals(draw):
    """Scores with ties, negatives and infinities; distances on both sides of, and at, the radius.

    At least one query is answerable.
    """
    shape = (draw(st.integers(1, 9)), draw(st.integers(1, 7)))
    few = st.sampled_from([-math.inf, -2.5, -1.0, 0.0, 0.5, 3.0])
    many = st.floats(-100, 100, width=32)
    scores = draw(hnp.arrays(np.float32, shape, elements=draw(st.sampled_from([few, many]))))
    places = st.sampled_from([0.0, 4.0, 10.0, 10.5, 30.0, 80.0])
    distances = draw(hnp.arrays(np.float64, shape, elements=places))
    distances[draw(st.integers(0, shape[0] - 1)), draw(st.integers(0, shape[1] - 1))] = 2.0
    return torch.from_numpy(scores), torch.from_numpy(distances)


def in_batches(metric, scores, distances, size=2):
    for start in range(0, len(scores), size):
        metric.update(scores[start : start + size], distances[start : start + size])
    return metric.compute()


def one_place(right, top, answerable=None):
    """Queries that retrieve rightly or wrongly with the given top scores, as two places."""
    answerable = [True] * len(right) if answerable is None else answerable
    scores = torch.tensor([[t, t - 1.0] for t in top])
    rows = [
        [3.0 if r else 50.0, 5.0 if a else 60.0] for r, a in zip(right, answerable, strict=True)
    ]
    return scores, torch.tensor(rows)


@settings(max_examples=150, deadline=None)
@given(retrievals(), st.integers(1, 8), st.sampled_from(["answerable", "all"]))
def test_recall_at_k_equals_the_reference(pair, k, over):
    expected = reference_recall(*(x.tolist() for x in pair), k, RADIUS, over)
    assert recall_at_k(*pair, k, RADIUS, over).item() == pytest.approx(expected, abs=1e-6)
    assert in_batches(RecallAtK(k, RADIUS, over), *pair).item() == pytest.approx(expected, abs=1e-6)


@settings(max_examples=150, deadline=None)
@given(retrievals())
def test_place_precision_recall_equals_the_reference(pair):
    expected = reference_curve(*(x.tolist() for x in pair), RADIUS)
    for curve in (
        place_precision_recall(*pair, RADIUS),
        in_batches(PlacePrecisionRecall(RADIUS), *pair),
    ):
        for values, reference in zip(curve, expected, strict=True):
            assert values.tolist() == pytest.approx(reference, abs=1e-6)
        assert (curve[1].diff() >= 0).all(), "recall never falls"


@settings(max_examples=150, deadline=None)
@given(retrievals())
def test_max_f1_and_place_auc_equal_the_reference(pair):
    arrays = [x.tolist() for x in pair]
    for function, metric, reference in (
        (max_f1, MaxF1(RADIUS), reference_f1(*arrays, RADIUS)),
        (place_auc, PlaceAUC(RADIUS), reference_auc(*arrays, RADIUS)),
    ):
        assert function(*pair, RADIUS).item() == pytest.approx(reference, abs=1e-6)
        assert in_batches(metric, *pair).item() == pytest.approx(reference, abs=1e-6)


@settings(max_examples=60, deadline=None)
@given(retrievals(), st.sampled_from([0.001, 7.0]), st.sampled_from([-50.0, 0.0, 50.0]))
def test_scale_and_offset_of_scores_do_not_matter(pair, scale, offset):
    scores, distances = pair[0].double().round(decimals=2), pair[1]
    moved = scores * scale + offset
    for function in (max_f1, place_auc):
        before, after = function(scores, distances, RADIUS), function(moved, distances, RADIUS)
        assert after.item() == pytest.approx(before.item(), abs=1e-6)


@settings(max_examples=60, deadline=None)
@given(retrievals())
def test_accepting_everything_gives_twice_r_over_one_plus_r(pair):
    """The bound by which 18 of the paper's 24 F1 values equal 2R / (1 + R)."""
    scores, distances = pair
    answerable = (distances <= RADIUS).any(dim=1)
    scores, distances = scores[answerable], distances[answerable]
    recall = recall_at_k(scores, distances, 1, RADIUS)
    precision, covered, _ = place_precision_recall(scores, distances, RADIUS)
    bound = (2 * recall / (1 + recall)).item()
    assert f1_along(precision, covered)[-1].item() == pytest.approx(bound, abs=1e-6)
    assert max_f1(scores, distances, RADIUS).item() >= bound - 1e-6


def test_equal_scores_rank_by_database_index():
    scores = torch.tensor([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
    distances = torch.tensor([[3.0, 50.0, 50.0], [50.0, 50.0, 3.0]])
    assert first_right(scores, distances, RADIUS)[1].tolist() == [1, 3]


def test_a_place_at_exactly_the_radius_is_right():
    scores, distances = torch.tensor([[1.0]]), torch.tensor([[10.0]])
    assert recall_at_k(scores, distances, 1, RADIUS) == 1


@pytest.fixture
def float64_by_default():
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


@pytest.mark.usefixtures("float64_by_default")
def test_exactly_the_radius_is_right_whatever_torchs_default_dtype():
    tenth = torch.tensor([[0.1]], dtype=torch.float32)  # above 0.1 by its rounding
    assert first_right_among(tenth, tenth[0], [0.1]).item() == 1


def test_ranks_are_counted_where_the_scores_are_whatever_torchs_default_device():
    scores, distances = torch.tensor([[1.0, 1.0, 2.0]]), torch.tensor([[50.0, 3.0, 50.0]])
    with torch.device("meta"):
        top, rank = first_right(scores, distances, RADIUS)
    assert (top.item(), rank.item()) == (2.0, 3)


@pytest.mark.parametrize(("precision", "recall"), [(0.2, 0.4), (0.01, 0.02), (0.5, 1.0), (1, 1)])
def test_f1_is_the_harmonic_mean_of_precision_and_recall(precision, recall):
    found = f1_along(torch.tensor([precision]), torch.tensor([recall]))
    assert found.item() == pytest.approx(statistics.harmonic_mean([precision, recall]))


def test_an_accepted_unanswerable_query_costs_precision_alone():
    scores, distances = one_place([True, False], [1.0, 2.0], answerable=[True, False])
    precision, recall, thresholds = place_precision_recall(scores, distances, RADIUS)
    assert thresholds.tolist() == [2.0, 1.0]
    assert precision.tolist() == [0.0, 0.5]
    assert recall.tolist() == [0.0, 1.0]


def test_nothing_right_gives_zeros_and_no_nan():
    scores, distances = one_place([False, False], [1.0, 2.0])
    assert max_f1(scores, distances, RADIUS) == 0
    assert place_auc(scores, distances, RADIUS) == 0


def test_auc_is_anchored_at_recall_zero_with_the_first_precision():
    area = area_under(torch.tensor([1.0, 0.5]), torch.tensor([0.5, 1.0]))
    assert area.item() == pytest.approx(0.5 + 0.5 * 0.75)


def test_counter_example_torchmetrics_recall_is_the_share_of_right_places():
    """Two right places, one retrieved: our Recall@1 is 1, the class of that name says 1/2."""
    scores, distances = torch.tensor([[0.9, 0.8, 0.1]]), torch.tensor([[2.0, 4.0, 50.0]])
    theirs = RetrievalRecall(top_k=1)
    theirs.update(scores[0], distances[0] <= RADIUS, indexes=torch.zeros(3, dtype=torch.long))
    assert theirs.compute().item() == 0.5
    assert recall_at_k(scores, distances, 1, RADIUS).item() == 1


def test_counter_example_torchmetrics_drops_scores_that_are_not_positive():
    """Negated distances are good scores; there the right place ranks first, theirs misses it.

    So it is from torchmetrics 1.8 on.
    """
    scores, distances = torch.tensor([[-0.1, -0.8, -0.9]]), torch.tensor([[2.0, 40.0, 50.0]])
    theirs = RetrievalRecall(top_k=1)
    theirs.update(scores[0], distances[0] <= RADIUS, indexes=torch.zeros(3, dtype=torch.long))
    drops = Version(torchmetrics.__version__) >= Version("1.8")
    assert theirs.compute().item() == (0 if drops else 1)
    assert recall_at_k(scores, distances, 1, RADIUS).item() == 1


def test_counter_example_torchmetrics_curve_takes_large_scores_through_a_sigmoid():
    """Correlations of 30 and more all become 1.0: a perfect ranking turns into one threshold."""
    scores, distances = one_place([True, True, False, False], [60.0, 50.0, 40.0, 30.0])
    theirs = BinaryPrecisionRecallCurve()
    theirs.update(scores[:, 0], (distances[:, 0] <= RADIUS).long())
    assert theirs.compute()[2].tolist() == 1.0
    assert place_precision_recall(scores, distances, RADIUS)[2].tolist() == [60, 50, 40, 30]


def test_trap_auc_looks_fine_while_recall_is_near_zero():
    """An unnormalised correlation: 1 query of 100 is right, and has the highest score.

    Counted as a classifier of its retrievals, where only right ones can be missed, the method is
    perfect. By the protocol wrong retrievals are missed places too, and distinct scores keep the
    area small; but where the wrong ones tie, one straight line still encloses half the square.
    """
    right = [True] + [False] * 99
    distinct = one_place(right, [200.0 - i for i in range(100)])
    tied = one_place(right, [200.0] + [100.0] * 99)
    recall = recall_at_k(*distinct, 1, RADIUS).item()
    assert recall == recall_at_k(*tied, 1, RADIUS).item() == pytest.approx(0.01)

    accepted = np.arange(1, 101)
    as_classifier = area_under(torch.from_numpy(1.0 / accepted), torch.ones(100))
    assert as_classifier.item() == 1.0
    assert place_auc(*distinct, RADIUS).item() < 0.05
    assert place_auc(*tied, RADIUS).item() > 0.5
    assert max_f1(*tied, RADIUS).item() == pytest.approx(2 * recall / (1 + recall), abs=1e-6)


def test_a_collection_without_groups_keeps_radii_apart():
    """In the first batch all ranks agree at 5 m and 10 m; from the second on they do not."""
    radii = (5.0, 10.0)
    collection = MetricCollection(
        {f"recall@{k}/{radius:g}": RecallAtK(k, radius) for k in (1, 5) for radius in radii}
        | {f"auc/{radius:g}": PlaceAUC(radius) for radius in radii},
        compute_groups=False,
    )
    collection.update(torch.tensor([[1.0, 0.5]]), torch.tensor([[3.0, 50.0]]))
    collection.update(torch.tensor([[1.0, 0.5]]), torch.tensor([[8.0, 3.0]]))
    values = collection.compute()
    assert (values["recall@1/5"], values["recall@1/10"]) == (0.5, 1.0)


def test_a_curve_of_one_threshold_is_still_a_curve():
    metric = PlacePrecisionRecall(RADIUS)
    metric.update(*one_place([True], [1.0]))
    assert [values.shape for values in pickle.loads(pickle.dumps(metric)).compute()] == [(1,)] * 3


def test_states_hold_two_numbers_a_query():
    metric = PlaceAUC(RADIUS)
    metric.update(torch.rand(50, 300), torch.rand(50, 300) * 40)
    assert metric.scores[0].numel() + metric.ranks[0].numel() == 100


def test_reset_forgets_and_forward_gives_the_batch():
    metric = RecallAtK(1, RADIUS)
    assert metric(*one_place([True], [1.0])) == 1
    assert metric(*one_place([False], [1.0])) == 0
    assert metric.compute() == 0.5
    metric.reset()
    metric.update(*one_place([False], [1.0]))
    assert metric.compute() == 0


@pytest.mark.parametrize("metric", [RecallAtK(1, 7.0), MaxF1(7.0), PlaceAUC(7.0)])
@pytest.mark.parametrize("over_queries", [3, 0])
def test_no_answerable_query_names_radius_and_counts(metric, over_queries):
    metric = metric.clone()
    metric.update(torch.rand(over_queries, 4), torch.full((over_queries, 4), 50.0))
    with pytest.raises(DeepringError, match=rf"radius 7 m: 0 of {over_queries} queries"):
        metric.compute()


@pytest.mark.parametrize(
    "function", [partial(recall_at_k, k=1), place_precision_recall, max_f1, place_auc]
)
def test_functions_without_an_answerable_query_name_radius_and_counts(function):
    with pytest.raises(DeepringError, match="radius 7 m: 0 of 3 queries"):
        function(torch.rand(3, 4), torch.full((3, 4), 50.0), radius=7.0)


@pytest.mark.filterwarnings("ignore:The ``compute`` method of metric:UserWarning")
def test_compute_before_any_update_is_refused():
    with pytest.raises(DeepringError, match="0 of 0 queries"):
        PlacePrecisionRecall(RADIUS).compute()


@pytest.mark.parametrize(
    ("scores", "distances", "message"),
    [
        (torch.rand(3, 4), torch.rand(4, 3), r"scores \(3, 4\) and distances \(4, 3\)"),
        (torch.rand(3), torch.rand(3), r"scores \(3,\)"),
        (torch.rand(3, 0), torch.rand(3, 0), "at least one place"),
        (torch.tensor([[math.nan, 1.0]]), torch.rand(1, 2), "^scores: float32, 1 NaN"),
        (torch.ones(1, 2, dtype=torch.long), torch.rand(1, 2), "^scores: int64, 0 NaN"),
        (torch.rand(1, 2), torch.tensor([[math.nan, 1.0]]), "distances: 1 negative or NaN"),
        (torch.rand(1, 2), torch.tensor([[-1.0, 1.0]]), "distances: 1 negative or NaN"),
    ],
)
def test_unusable_input_is_refused(scores, distances, message):
    with pytest.raises(DeepringError, match=message):
        PlaceAUC(RADIUS).update(scores, distances)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"k": 0, "radius": 10.0}, "k: 0"),
        ({"k": 1.5, "radius": 10.0}, "k: 1.5"),
        ({"k": 1, "radius": -1.0}, "radius: -1"),
        ({"k": 1, "radius": math.nan}, "radius: nan"),
        ({"k": 1, "radius": 10.0, "over": "some"}, "over: 'some'"),
    ],
)
def test_unusable_arguments_are_refused(arguments, message):
    with pytest.raises(DeepringError, match=message):
        RecallAtK(**arguments)
    with pytest.raises(DeepringError, match=message):
        recall_at_k(torch.rand(1, 1), torch.rand(1, 1), **arguments)


def test_docstring_examples_run():
    outcomes = [doctest.testmod(module) for module in (metrics, batched_metrics, case)]
    assert sum(outcome.failed for outcome in outcomes) == 0
    assert sum(outcome.attempted for outcome in outcomes) >= 20
