"""The protocol on a toy method whose answers are known: counts, recall, places, errors."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from deepring.data.dataset import RetrievalSet
from deepring.data.packed_rasters import Rasters, pack
from deepring.data.scan_set import ScanSet
from deepring.data.session import Session
from deepring.errors import DeepringError
from deepring.evaluation import protocol
from deepring.evaluation.case import Case
from deepring.evaluation.counting import precision_recall
from deepring.evaluation.descriptors import read_descriptors
from deepring.evaluation.matches import COLUMNS
from deepring.evaluation.protocol import evaluate_method
from deepring.evaluation.task import RetrievalTask, rows_of
from deepring.methods.method import Comparison, Method, describe_all
from deepring.rasters import BevRaster

RASTER = BevRaster(cells=8)


class Toy:
    """A scan's image is a number in binary; equal numbers are the same place, near ones alike."""

    raster = RASTER

    def __init__(self, *, turn=True):
        self.turn = turn
        self.described = []
        self._calls = []

    def describe(self, rasters):
        self.described.append(len(rasters))
        self._calls.append("describe")
        return (rasters[..., 0, :].float() * 2.0 ** torch.arange(7, -1, -1)).sum(-1)

    def compare(self, queries, database):
        self._calls.append("compare")
        apart = queries[:, None] - database[None]
        return Comparison(-apart.abs(), apart / 100 if self.turn else None)


def side(numbers, east):
    """Scans at (east, 0) metres, away from the origin as UTM is."""
    n = len(numbers)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = np.array(east, dtype=np.float64) + 345090.0
    poses[:, 1, 3] = 4037591.0
    cloud = np.random.default_rng(0).uniform(-40, 40, (200, 3)).astype(np.float32)
    session = Session("s", (None,) * n, poses, poses[:, :2, 3].copy(), None, lambda _: cloud)
    images = [np.unpackbits(np.array([k] + [0] * 7, dtype=np.uint8)) for k in numbers]
    packed = [pack(image.reshape(8, 8).astype(bool), RASTER) for image in images]
    data = np.stack(packed) if n else np.zeros((0, 8), np.uint8)
    return ScanSet(session, np.arange(n)), Rasters(data, RASTER)


def task(numbers, east):
    """Places 10, 20, 30, 40 at 0, 20, 40, 60 m."""
    return of_sides(side([10, 20, 30, 40], [0, 20, 40, 60]), side(numbers, east))


def of_sides(database, query):
    scans = RetrievalSet("sim", "test", database[0], query[0])
    return RetrievalTask(scans, database[1], query[1])


def evaluated(method, tested, radii=(10.0, 5.0, 15.0, 20.0, 25.0), train="", **options):
    return evaluate_method(tested.case("toy", train), method, tested, radii, **options)


#: Queries: two right, one right at 12 m only, one wrong, one near no place at all.
FIVE = ([10, 21, 30, 39, 41], [1, 22, 52, 3, 500])


def test_the_toy_is_a_method():
    assert isinstance(Toy(), Method)


def test_best_places_scores_turns_and_distances():
    matches = evaluated(Toy(), task(*FIVE)).matches
    assert matches.place.shape == (5, 4)
    assert matches.place[:, 0].tolist() == [0, 1, 2, 3, 3]
    assert matches.place[3].tolist() == [3, 2, 1, 0]
    assert matches.score[:, 0].tolist() == [0, -1, 0, -1, -1]
    assert matches.turn[:, 0].tolist() == pytest.approx([0, 0.01, 0, -0.01, 0.01])
    assert matches.distance[:, 0].tolist() == [1, 2, 12, 57, 440]
    assert matches.distance[3].tolist() == [57, 37, 17, 3]
    assert matches.nearest.tolist() == [1, 2, 8, 3, 440]


def test_counts_and_recall_at_each_radius():
    outcome = evaluated(Toy(), task(*FIVE), radii=(10.0, 5.0, 12.0), train="city")
    by_radius = {row.radius_m: row for row in outcome.results}
    assert list(by_radius) == [10.0, 5.0, 12.0]
    for row in outcome.results:
        assert row.case == Case("toy", "city", "sim", "test")
        assert (row.database, row.queries) == (4, 5)
        assert row.recall_5 == 1.0  # of four places each is among the first five
    # The query at 500 m counts for no recall; the one at 52 m has a place within 10 m, at 60 m.
    assert [by_radius[r].answerable for r in (5.0, 10.0, 12.0)] == [3, 4, 4]
    assert by_radius[5.0].recall_1 == pytest.approx(2 / 3)
    assert by_radius[10.0].recall_1 == pytest.approx(2 / 4)
    assert by_radius[12.0].recall_1 == pytest.approx(3 / 4)


def test_a_perfect_method_scores_one_everywhere():
    outcome = evaluated(Toy(), task([10, 30, 40], [1, 41, 62]), radii=(5.0,))
    (row,) = outcome.results
    assert (row.recall_1, row.recall_5, row.f1_max, row.auc) == (1, 1, 1, 1)


def test_the_curve_is_that_of_the_radius_asked_for():
    matches = evaluated(Toy(), task(*FIVE), radii=(12.0, 5.0)).matches
    precision, recall, thresholds = precision_recall(matches, 12.0)
    assert thresholds.tolist() == [0, -1]
    assert precision.tolist() == pytest.approx([2 / 2, 3 / 5])
    # One answerable query is accepted with a wrong place: that costs precision, not recall.
    assert recall.tolist() == pytest.approx([2 / 4, 1.0])
    assert precision_recall(matches, 5.0)[0].tolist() != precision.tolist()


def without_seconds(row):
    values = vars(row).copy()
    return {k: v for k, v in values.items() if not k.startswith("seconds")}


def assert_same_matches(ours, theirs):
    for name in COLUMNS:
        values = getattr(theirs.matches, name)
        np.testing.assert_array_equal(getattr(ours.matches, name), values, err_msg=name)


@pytest.mark.parametrize("batch", [1, 3, 7, 8, 100])
def test_results_do_not_depend_on_the_batch(batch, monkeypatch):
    rng = np.random.default_rng(1)
    numbers, east = rng.integers(0, 256, 8), rng.uniform(0, 60, 8)
    expected = evaluated(Toy(), task(numbers, east))
    monkeypatch.setattr(protocol, "BATCH", batch)
    outcome = evaluated(Toy(), task(numbers, east))
    assert list(map(without_seconds, outcome.results)) == list(
        map(without_seconds, expected.results)
    )
    assert_same_matches(outcome, expected)


def test_a_method_that_knows_no_turns_gives_none():
    assert evaluated(Toy(turn=False), task(*FIVE)).matches.turn is None


def test_of_equal_scores_the_first_place_is_taken():
    matches = evaluated(Toy(), task([25], [21]), radii=(5.0,)).matches
    assert matches.place.tolist() == [[1, 2, 0, 3]]  # 20 and 30 are equally far from 25


def test_distances_to_utm_positions_are_exact():
    matches = evaluated(Toy(), task([20], [20.03]), radii=(5.0,)).matches
    assert matches.distance[:, 0].tolist() == pytest.approx([0.03], abs=1e-6)


def test_seconds_are_positive():
    for row in evaluated(Toy(), task(*FIVE)).results:
        assert row.seconds_per_scan > 0
        assert row.seconds_per_query > 0


def test_a_scan_is_timed_from_its_points_one_at_a_time():
    method = Toy()
    timed = protocol.seconds_per_scan(method, task(*FIVE).scans.query, count=3)
    assert timed > 0
    assert method.described == [1, 1, 1]


def test_the_default_headline_is_ten_metres_beside_the_others():
    rows = evaluated(Toy(), task(*FIVE)).results
    assert [row.radius_m for row in rows] == [10, 5, 15, 20, 25]


@pytest.mark.parametrize("empty", ["database", "query"])
def test_an_empty_side_is_named(empty):
    full, nothing = side([10], [0]), side([], [])
    sides = {"database": full, "query": full, empty: nothing}
    with pytest.raises(DeepringError, match=rf"region test: the {empty} holds 0 scans"):
        evaluated(Toy(), of_sides(**sides))


def test_no_answerable_query_is_an_error_before_anything_is_described():
    method = Toy()
    message = r"sim, region test: radius 10 m: 0 of 2 queries .* nearest lies at 240 m; .* wider"
    with pytest.raises(DeepringError, match=message):
        evaluated(method, task([10, 20], [300, 400]))
    assert method.described == []


def test_a_query_at_exactly_the_radius_is_answerable():
    (row,) = evaluated(Toy(), task([40], [72]), radii=(12.0,)).results
    assert row.answerable == 1
    with pytest.raises(DeepringError, match=r"radius 11\.99 m: 0 of 1 .* at 12 m"):
        evaluated(Toy(), task([40], [72]), radii=(11.99,))


def test_a_further_radius_without_an_answer_is_left_out_and_named(caplog):
    outcome = evaluated(Toy(), task([10], [1]), radii=(10.0, 0.5))
    assert [row.radius_m for row in outcome.results] == [10.0]
    assert "within 0.5 m" in caplog.text
    with pytest.raises(DeepringError, match=r"radius 0\.5 m: 0 of 1"):  # but not the headline
        evaluated(Toy(), task([10], [1]), radii=(0.5, 10.0))


def test_no_radius_and_one_that_is_no_length_are_errors():
    with pytest.raises(DeepringError, match="radii: empty, expected at least one"):
        evaluated(Toy(), task(*FIVE), radii=())
    with pytest.raises(DeepringError, match=r"radius: -5\.0, expected a number of metres"):
        evaluated(Toy(), task(*FIVE), radii=(10.0, -5.0))


def test_without_an_export_one_batch_of_queries_is_held_at_a_time(monkeypatch):
    monkeypatch.setattr(protocol, "BATCH", 2)
    monkeypatch.setattr(protocol, "seconds_per_scan", lambda *_: 0.0)
    method = Toy()
    evaluated(method, task(*FIVE))
    described = [calls for calls in method._calls if calls == "describe"]
    assert method.described == [2, 2, 2, 2, 1]
    assert len(described) == 5
    # Each batch of queries is compared before the next one is described.
    assert method._calls[-1] == "compare"
    assert "compare" in method._calls[method._calls.index("compare") : -1]
    last = len(method._calls) - 1 - method._calls[::-1].index("describe")
    assert "compare" in method._calls[:last]


def test_rows_are_found_by_the_numbers_of_scans():
    scans = replace(side([1, 2, 3], [0, 1, 2])[0], indices=np.array([40, 7, 12]))
    assert rows_of(scans, np.array([[12, 40], [7, 7]])).tolist() == [[2, 0], [1, 1]]
    for absent in (8, 41, -1):
        with pytest.raises(DeepringError, match=rf"scans \[{absent}\] of session s: not among"):
            rows_of(scans, np.array([40, absent]))


def test_an_export_changes_no_figure_and_leaves_two_files(tmp_path):
    expected = evaluated(Toy(), task(*FIVE), train="city")
    folder = tmp_path / "run" / "descriptors"
    outcome = evaluated(Toy(), task(*FIVE), train="city", export=folder)
    assert list(map(without_seconds, outcome.results)) == list(
        map(without_seconds, expected.results)
    )
    assert_same_matches(outcome, expected)
    files = {f"toy__sim__test__{what}.safetensors" for what in ("database", "query")}
    assert {path.name for path in folder.iterdir()} == files


def test_an_export_holds_what_was_described_and_what_made_it(tmp_path):
    tested = task(*FIVE)
    tested = replace(tested, scans=replace(tested.scans, query=turned(tested.scans.query)))
    outcome = evaluated(Toy(), tested, train="city", export=tmp_path)
    sides = {"database": tested.scans.database, "query": tested.scans.query}
    numbers = {"database": [10, 20, 30, 40], "query": FIVE[0]}
    for which, expected in sides.items():
        found = read_descriptors(tmp_path / f"toy__sim__test__{which}.safetensors")
        assert found.descriptors.tolist() == numbers[which]
        assert np.array_equal(found.positions, expected.positions)
        assert np.array_equal(found.indices, expected.indices)
        assert (found.side, found.session, found.ground_z) == (which, "s", 0.0)
        assert found.case == tested.case("toy", "city")
        assert found.made_by["method"] == "test_protocol.Toy"
        assert found.made_by["raster"]["cells"] == 8
        assert found.made_by["values"] == {"described": [], "turn": True}
        assert found.seconds_per_scan == outcome.results[0].seconds_per_scan
    assert found.turns.tolist() == [0, 1, 2, 3, 4]


def turned(scans):
    return replace(scans, turns=np.arange(len(scans)) * 1.0)


def test_what_cannot_be_exported_is_refused_before_the_queries_are_described(tmp_path):
    method = Toy()
    method.kernel = np.sin
    with pytest.raises(DeepringError, match=r"Toy\.kernel: a ufunc, expected a plain value"):
        evaluated(method, task(*FIVE), export=tmp_path)
    assert method.described == []

    class Exact(Toy):
        def describe(self, rasters):
            return super().describe(rasters).double()

    method, tested = Exact(), task(*FIVE)
    with pytest.raises(
        DeepringError, match=r"database: tensor descriptors: float64 of .* expected float32"
    ):
        evaluated(method, tested, export=tmp_path)
    assert sum(n > 1 for n in method.described) == 1  # scans that are timed come one at a time
    assert list(tmp_path.iterdir()) == []
    assert evaluated(Exact(), tested).results  # all the same without an export


def test_an_export_replaces_its_own_files_and_no_other_method_s(tmp_path):
    tested = task(*FIVE)
    for _ in range(2):
        evaluate_method(tested.case("to y"), Toy(), tested, export=tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    method = Toy()
    with pytest.raises(DeepringError, match="give the methods labels that differ in letters"):
        evaluate_method(tested.case("to/y"), method, tested, export=tmp_path)
    assert method.described == []
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("batch", [1, 2, 5, 6])
def test_descriptions_come_in_order_and_in_batches(batch):
    method, (_, images) = Toy(), side([5, 3, 9, 200, 0], [0] * 5)
    assert describe_all(method, images, batch).tolist() == [5, 3, 9, 200, 0]
    assert max(method.described) <= batch
    assert sum(method.described) == 5
