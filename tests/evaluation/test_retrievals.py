"""Retrievals survive the file to the last digit, and give the protocol's curve."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from deepring.errors import DeepringError
from deepring.evaluation.metrics import place_precision_recall
from deepring.evaluation.protocol import Retrieved
from deepring.evaluation.retrievals import (
    precision_recall_of,
    read_retrievals,
    retrievals_in,
    write_retrievals,
)

LABELS = ("Scan Context 20x60", "", "sim_nclt", "test")


def floats(n, **limits):
    return hnp.arrays(np.float32, n, elements=st.floats(width=32, allow_nan=False, **limits))


@st.composite
def any_retrieved(draw):
    """Of one to five queries in up to four places, and the scans' indices of both."""
    n, d = draw(st.integers(1, 5)), draw(st.integers(1, 4))
    turn = draw(st.none() | floats(n, allow_infinity=False))
    metres = floats(n, min_value=0)
    place = draw(hnp.arrays(np.int64, n, elements=st.integers(0, d - 1)))
    retrieved = Retrieved(place, draw(floats(n)), turn, draw(metres), draw(metres))
    scans = st.integers(0, 2**40)
    return (
        retrieved,
        draw(hnp.arrays(np.int64, n, elements=scans)),
        draw(hnp.arrays(np.int64, d, elements=scans)),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("run")


def retrieved(n=3, turn=True):
    rows = np.arange(n)
    lengths = rows.astype(np.float32)
    turns = lengths / 10 if turn else None
    return Retrieved(rows % 2, -lengths / 3, turns, lengths + 4, lengths)


def write(folder, labels=LABELS, n=3, turn=True):
    return write_retrievals(folder, *labels, retrieved(n, turn), np.arange(n) + 7, [20, 30])


@settings(max_examples=60, deadline=None)
@given(any_retrieved(), st.tuples(*[st.text(max_size=9)] * 4))
def test_round_trip_is_exact(folder, made, labels):
    found, queries, places = made
    for old in folder.rglob("*.csv"):
        old.unlink()
    read = read_retrievals(write_retrievals(folder, *labels, found, queries, places))
    assert (read.method, read.train, read.test, read.region) == labels
    np.testing.assert_array_equal(read.query, queries)
    np.testing.assert_array_equal(read.place, places[found.place], "the scan, not its number")
    for name in ("score", "distance", "nearest"):
        np.testing.assert_array_equal(getattr(read, name), getattr(found, name))
        assert getattr(read, name).dtype == np.float32
    if found.turn is None:
        assert read.turn is None
    else:
        np.testing.assert_array_equal(read.turn, found.turn)


def test_the_file_is_named_after_method_and_test_and_its_first_line_says_all(tmp_path):
    path = write(tmp_path)
    assert path == tmp_path / "retrievals" / "Scan_Context_20x60__sim_nclt__test.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines == [
        '# {"method": "Scan Context 20x60", "train": "", "test": "sim_nclt", "region": "test"}',
        "query,place,score,turn,distance,nearest",
        "7,20,-0.0,0.0,4.0,0.0",
        "8,30,-0.3333333432674408,0.10000000149011612,5.0,1.0",
        "9,20,-0.6666666865348816,0.20000000298023224,6.0,2.0",
    ]


def test_a_yaw_that_is_not_known_is_empty(tmp_path):
    path = write(tmp_path, turn=False)
    assert "8,30,-0.3333333432674408,,5.0,1.0" in path.read_text().splitlines()


@pytest.mark.parametrize("label", ["../up", "a/b\\c", "RING[fast]", "Ünïcode", "a\nb", ". .", ""])
def test_any_label_makes_a_safe_name_and_survives(tmp_path, label):
    path = write(tmp_path, (label, label, label, label))
    assert path.parent == tmp_path / "retrievals"
    assert set(path.stem) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_")
    assert read_retrievals(path).method == label


def test_again_is_written_over_but_not_another_methods_file(tmp_path):
    path = write(tmp_path, ("RING[a]", "", "sim", "test"))
    write(tmp_path, ("RING[a]", "", "sim", "test"), n=2)
    assert len(read_retrievals(path).query) == 2
    before = path.read_bytes()
    message = r"RING_a___sim__test\.csv: holds the retrievals of .*RING\[a\].*, expected those of"
    for labels in (("RING(a)", "", "sim", "test"), ("RING[a]", "x", "sim", "test")):
        with pytest.raises(DeepringError, match=message):
            write(tmp_path, labels)
    assert path.read_bytes() == before


@pytest.mark.parametrize(("queries", "places"), [(2, 2), (3, 1), (4, 9)])
def test_indices_that_do_not_fit_are_refused(tmp_path, queries, places):
    with pytest.raises(DeepringError, match=r"query_indices .*: expected one a query, \(3,\), and"):
        write_retrievals(tmp_path, *LABELS, retrieved(), np.arange(queries), np.arange(places))
    assert not list(tmp_path.rglob("*.csv"))


def test_those_of_a_run_are_read_in_order_and_none_where_there_are_none(tmp_path):
    assert list(retrievals_in(tmp_path)) == []
    write(tmp_path, ("b", "", "sim", "test"))
    write(tmp_path, ("a", "", "sim", "test"))
    assert [found.method for found in retrievals_in(tmp_path)] == ["a", "b"]


HEAD = '# {"method": "m", "train": "", "test": "t", "region": "r"}\n'
COLUMNS = "query,place,score,turn,distance,nearest\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: ''; expected '# '"),
        (COLUMNS, r"line 1: 'query,place.*; expected '# ' and {\"method\""),
        ('# {"method": "m"}\n' + COLUMNS, "line 1"),
        (HEAD + "query,place\n", "line 2: expected 'query,place,score,turn,distance,nearest'"),
        (HEAD + COLUMNS + "1,2,0.5,,1.0,1.0\n1,x,0.5,,1.0,1.0\n", "line 4: '1,x,0.5"),
        (HEAD + COLUMNS + "1,2,0.5,1.0,1.0\n", "line 3: .*expected two whole numbers and four"),
        (HEAD + COLUMNS + "1,2,,0.1,1.0,1.0\n", "line 3"),
        (HEAD + COLUMNS + '1,"2', "expected the retrievals of an evaluation"),
        ("\x80", "expected the retrievals of an evaluation"),
        (None, "No such file"),
    ],
)
def test_what_is_no_such_file_is_refused_with_its_line(tmp_path, text, message):
    path = tmp_path / "found.csv"
    if text is not None:
        path.write_text(text, encoding="latin-1")
    with pytest.raises(DeepringError, match=rf"found\.csv.*{message}"):
        read_retrievals(path)


matrices = st.tuples(st.integers(1, 8), st.integers(1, 6)).flatmap(
    lambda shape: st.tuples(
        # few values, so that equal scores are frequent
        hnp.arrays(np.float32, shape, elements=st.sampled_from([-np.inf, -1, 0, 0.5, 2])),
        hnp.arrays(np.float32, shape, elements=st.sampled_from([0, 5, 10, 10.5, 40])),
    )
)


@settings(deadline=None)
@given(matrices)
def test_the_curve_is_that_of_the_whole_matrices(made):
    scores, distances = made
    best = scores.argmax(axis=1)[:, None]
    distance = np.take_along_axis(distances, best, 1)[:, 0]
    found = (distance, distances.min(axis=1), scores.max(axis=1))
    if not (distances <= 10).any():
        with pytest.raises(DeepringError, match="radius 10 m: 0 of"):
            precision_recall_of(*found, radius=10.0)
        return
    expected = place_precision_recall(torch.from_numpy(scores), torch.from_numpy(distances), 10.0)
    for own, whole in zip(precision_recall_of(*found, radius=10.0), expected, strict=True):
        torch.testing.assert_close(own, whole, rtol=0, atol=0)


def test_an_unanswerable_query_costs_precision_and_no_recall():
    precision, recall, _ = precision_recall_of(
        [1.0, 40.0, 40.0], [1.0, 40.0, 2.0], [3, 2.0, 1], 10.0
    )
    assert precision.tolist() == pytest.approx([1, 1 / 2, 1 / 3])
    assert recall.tolist() == pytest.approx([1 / 2, 1 / 2, 1])


@pytest.mark.parametrize("shapes", [(3, 2, 3), (3, 3, 2)])
def test_numbers_of_other_lengths_are_refused(shapes):
    with pytest.raises(DeepringError, match=r"distance .* expected \(q,\) each"):
        precision_recall_of(*map(np.zeros, shapes), radius=10.0)


def test_the_curve_of_a_file_is_the_protocols(tmp_path):
    rng = np.random.default_rng(0)
    scores = rng.normal(size=(50, 9)).astype(np.float32)
    distances = rng.uniform(0, 60, (50, 9)).astype(np.float32)
    best = scores.argmax(1)
    rows = np.arange(50)
    kept = Retrieved(best, scores[rows, best], None, distances[rows, best], distances.min(1))
    path = write_retrievals(tmp_path, *LABELS, kept, rows, np.arange(9))
    read = read_retrievals(path)
    own = precision_recall_of(read.distance, read.nearest, read.score, 12.3)
    whole = place_precision_recall(torch.from_numpy(scores), torch.from_numpy(distances), 12.3)
    assert all(torch.equal(a, b) for a, b in zip(own, whole, strict=True))
