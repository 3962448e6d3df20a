"""Matches survive the file to the last digit."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.evaluation.counting import precision_recall
from deepring.evaluation.matches import TopMatches, matches_in, read_matches, write_matches
from deepring.evaluation.metrics import place_precision_recall

CASE = Case("Scan Context 20x60", "", "sim_nclt", "test")

printable = st.text(st.characters(exclude_categories=["C", "Z"]), max_size=9)


def floats(shape, **limits):
    return hnp.arrays(np.float32, shape, elements=st.floats(width=32, allow_nan=False, **limits))


@st.composite
def any_matches(draw):
    """Of one to five queries, up to four places each."""
    n, k = draw(st.integers(1, 5)), draw(st.integers(1, 4))
    scans = st.integers(0, 2**40)
    return TopMatches(
        Case(*draw(st.tuples(*[printable] * 4))),
        query=draw(hnp.arrays(np.int64, n, elements=scans)),
        place=draw(hnp.arrays(np.int64, (n, k), elements=scans)),
        score=draw(floats((n, k))),
        turn=draw(st.none() | floats((n, k), allow_infinity=False)),
        distance=draw(floats((n, k), min_value=0, allow_infinity=False)),
        nearest=draw(floats(n, min_value=0, allow_infinity=False)),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("run")


def example(case=CASE, n=3, turn=True):
    rows = np.arange(n, dtype=np.float32)[:, None]
    turns = rows / 10 if turn else None
    places = np.array([20, 30])[np.arange(n) % 2][:, None]
    return TopMatches(case, np.arange(n) + 7, places, -rows / 3, turns, rows + 4, rows[:, 0])


@settings(max_examples=60, deadline=None)
@given(any_matches())
def test_the_round_trip_of_the_best_place_is_exact(folder, matches):
    for old in folder.rglob("*.csv"):
        old.unlink()
    read = read_matches(write_matches(folder, matches))
    assert read.case == matches.case
    for name in ("query", "nearest"):
        np.testing.assert_array_equal(getattr(read, name), getattr(matches, name))
    for name in ("place", "score", "turn", "distance"):
        ours, theirs = getattr(read, name), getattr(matches, name)
        if theirs is None:
            assert ours is None
            continue
        np.testing.assert_array_equal(ours, theirs[:, :1])
        assert ours.dtype == theirs.dtype


def test_the_file_is_named_after_method_and_test_and_its_first_line_says_all(tmp_path):
    path = write_matches(tmp_path, example())
    assert path == tmp_path / "retrievals" / "Scan_Context_20x60__sim_nclt__test.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines == [
        '# {"method": "Scan Context 20x60", "train": "", "test": "sim_nclt", "region": "test"}',
        "query,place,score,turn,distance,nearest",
        "7,20,-0.0,0.0,4.0,0.0",
        "8,30,-0.3333333432674408,0.10000000149011612,5.0,1.0",
        "9,20,-0.6666666865348816,0.20000000298023224,6.0,2.0",
    ]


def test_a_turn_that_is_not_known_is_empty(tmp_path):
    path = write_matches(tmp_path, example(turn=False))
    assert "8,30,-0.3333333432674408,,5.0,1.0" in path.read_text().splitlines()


@pytest.mark.parametrize("label", ["../up", "a/b\\c", "RING[fast]", "Ünïcode", ". .", ""])
def test_any_label_makes_a_safe_name_and_survives(tmp_path, label):
    path = write_matches(tmp_path, example(Case(label, label, label, label)))
    assert path.parent == tmp_path / "retrievals"
    assert set(path.stem) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_")
    assert read_matches(path).case.method == label


def test_again_is_written_over_but_not_another_methods_file(tmp_path):
    case = Case("RING[a]", "", "sim", "test")
    path = write_matches(tmp_path, example(case))
    write_matches(tmp_path, example(case, n=2))
    assert len(read_matches(path).query) == 2
    before = path.read_bytes()
    message = r"RING_a___sim__test\.csv: holds the retrievals of .*RING\[a\].*, expected those of"
    for other in (Case("RING(a)", "", "sim", "test"), Case("RING[a]", "x", "sim", "test")):
        with pytest.raises(DeepringError, match=message):
            write_matches(tmp_path, example(other))
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    "change",
    [
        {"query": np.arange(2)},
        {"nearest": np.zeros((3, 1), np.float32)},
        {"place": np.arange(3)},
        {"score": np.zeros((3, 2), np.float32)},
        {"turn": np.zeros(3, np.float32)},
        {name: np.zeros((3, 0), np.float32) for name in ("place", "score", "turn", "distance")},
    ],
)
def test_arrays_that_do_not_fit_are_refused(change):
    arrays = {**vars(example()), **change}
    with pytest.raises(DeepringError, match=r"matches of .*expected \(q,\) for query and nearest"):
        TopMatches(**arrays)


def test_those_of_a_run_are_read_in_order_and_none_where_there_are_none(tmp_path):
    assert list(matches_in(tmp_path)) == []
    write_matches(tmp_path, example(Case("b", "", "sim", "test")))
    write_matches(tmp_path, example(Case("a", "", "sim", "test")))
    assert [matches.case.method for matches in matches_in(tmp_path)] == ["a", "b"]


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
        (None, "cannot be read"),
    ],
)
def test_what_is_no_such_file_is_refused_with_its_line(tmp_path, text, message):
    path = tmp_path / "found.csv"
    if text is not None:
        path.write_text(text, encoding="latin-1")
    with pytest.raises(DeepringError, match=rf"found\.csv.*{message}"):
        read_matches(path)


def test_the_curve_of_a_file_is_that_of_the_whole_matrices(tmp_path):
    rng = np.random.default_rng(0)
    scores = rng.normal(size=(50, 9)).astype(np.float32)
    distances = rng.uniform(0, 60, (50, 9)).astype(np.float32)
    best = np.argsort(-scores, kind="stable")[:, :5]
    score, distance = (np.take_along_axis(table, best, 1) for table in (scores, distances))
    matches = TopMatches(CASE, np.arange(50), best, score, None, distance, distances.min(1))
    read = read_matches(write_matches(tmp_path, matches))
    whole = place_precision_recall(torch.from_numpy(scores), torch.from_numpy(distances), 12.3)
    for kept in (matches, read):
        own = precision_recall(kept, 12.3)
        assert all(torch.equal(a, b) for a, b in zip(own, whole, strict=True))


@pytest.mark.parametrize(
    "row",
    [
        "1,2,0.5,0.1,1e300,3.0",  # beyond float32
        "99999999999999999999,2,0.5,0.1,1.0,3.0",  # beyond int64
        "-1,2,0.5,0.1,1.0,3.0",
        "1,2,,0.1,1.0,3.0",
    ],
)
def test_numbers_that_no_match_has_are_refused_with_their_line(tmp_path, row):
    path = tmp_path / "a.csv"
    path.write_text(f"{HEAD}{COLUMNS}1,2,0.5,0.1,1.0,3.0\n{row}\n")
    with pytest.raises(DeepringError, match=r"a\.csv, line 4: .*expected two whole numbers"):
        read_matches(path)


def test_turns_are_in_each_row_or_in_none(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(f"{HEAD}{COLUMNS}1,2,0.5,0.1,1.0,3.0\n3,4,0.5,,1.0,3.0\n")
    with pytest.raises(DeepringError, match=r"turns in 1 of 2 rows; expected one in each"):
        read_matches(path)
