"""Results survive the file, and files that cannot be right are refused with their line."""

import math
from dataclasses import FrozenInstanceError, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.evaluation.results import COLUMNS, Result, read_results, write_results
from helpers.results import result_of

CASE = Case("DeepRING", "nclt", "mulran", "test")
EXAMPLE = result_of(
    CASE, 10.0, (120, 480, 450), (0.9, 0.95, 0.947, 0.99), (0.004, 1e-5), wrong_beyond_m=20.0
)

printable = st.characters(exclude_categories=["C", "Z"], include_characters=" ")
names = st.text(printable, max_size=12)
rates = st.floats(0, 1)
seconds = st.floats(0, allow_infinity=False)
counts = st.integers(0, 10**9)


@st.composite
def any_result(draw):
    radius = draw(st.floats(0, exclude_min=True, allow_infinity=False))
    queries = draw(counts)
    beyond = draw(st.floats(radius, allow_infinity=False))
    tested = (radius, beyond, draw(counts), queries, draw(st.integers(0, queries)))
    reached = (*(draw(rates) for _ in range(6)), draw(seconds), draw(seconds))
    return Result(Case(*(draw(names) for _ in range(4))), *tested, *reached)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("results")


@settings(max_examples=50, deadline=None)
@given(st.lists(any_result(), max_size=4))
def test_round_trip_is_exact(folder, results):
    write_results(folder / "results.csv", results)
    assert read_results(folder / "results.csv") == results


def test_the_columns_are_these():
    assert ",".join(COLUMNS) == (
        "method,train,test,region,radius_m,wrong_beyond_m,database,queries,answerable,"
        "recall_1,recall_1_low,recall_1_high,recall_5,recall_5_low,recall_5_high,"
        "recall_1_percent,recall_1_percent_low,recall_1_percent_high,"
        "f1_max,auc,ap,seconds_per_scan,seconds_per_query"
    )


def test_a_result_cannot_be_changed():
    with pytest.raises(FrozenInstanceError):
        EXAMPLE.auc = 1.0


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("radius_m", 0.0),
        ("radius_m", math.inf),
        ("wrong_beyond_m", 9.9),
        ("database", -1),
        ("queries", 480.0),
        ("answerable", 481),
        ("recall_1", 1.1),
        ("auc", math.nan),
        ("auc", None),
        ("ap", -0.1),
        ("seconds_per_scan", -0.1),
        ("seconds_per_query", math.inf),
    ],
)
def test_a_value_out_of_range_is_named(field, value):
    with pytest.raises(DeepringError, match=rf"{field}: .*expected"):
        replace(EXAMPLE, **{field: value})


def test_write_creates_folders_and_leaves_no_temporary_file(tmp_path):
    path = tmp_path / "new" / "results.csv"
    write_results(path, [EXAMPLE])
    assert list(path.parent.iterdir()) == [path]
    assert path.read_bytes().count(b"\n") == 2
    assert b"\r" not in path.read_bytes()


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "results.csv"
    write_results(path, [EXAMPLE])

    def breaking():
        yield EXAMPLE
        raise RuntimeError("interrupted")

    with pytest.raises(RuntimeError, match="interrupted"):
        write_results(path, breaking())
    assert read_results(path) == [EXAMPLE]
    assert list(tmp_path.iterdir()) == [path]


def test_a_path_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DeepringError, match="expected a writable path"):
        write_results(tmp_path / "file" / "results.csv", [EXAMPLE])


def test_a_spreadsheet_s_byte_order_mark_and_line_ends_are_read(tmp_path):
    path = tmp_path / "results.csv"
    write_results(path, [EXAMPLE])
    text = path.read_text(encoding="utf-8").replace("\n", "\r\n")
    path.write_bytes(f"\ufeff{text}\r\n".encode())
    assert read_results(path) == [EXAMPLE]


def written(tmp_path, change):
    path = tmp_path / "results.csv"
    write_results(path, [EXAMPLE, EXAMPLE])
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("auc", "AUC"), r"missing \['auc'\], unknown \['AUC'\]"),
        (lambda text: text[:0], "header ''"),
        (lambda text: text.replace(",450,", ",many,", 1), "line 2: answerable: 'many', .*a whole"),
        (lambda text: text[:-1].rsplit(",", 1)[0] + ",soon\n", "line 3: seconds_per_query: 'soon'"),
        (lambda text: text.replace(",0.9,", ",1.9,", 1), r"line 2: recall_1: 1\.9"),
        (lambda text: text.replace(",0.9,", ",", 1), "line 2: 22 values; expected 23"),
        (
            lambda text: text.replace(str(EXAMPLE.interval("recall_1")[0]), "0.5", 1),
            r"line 2: recall_1_low: 0\.5, expected a bound of 0\.868",
        ),
        (lambda text: text + '"open', "is not valid CSV"),
        (lambda text: text.replace("mulran", "mul\x07ran", 1), "line 2: test: "),
    ],
)
def test_a_file_that_cannot_be_right_is_refused(tmp_path, change, message):
    with pytest.raises(DeepringError, match=message):
        read_results(written(tmp_path, change))


def test_a_missing_file_and_one_that_is_no_text_are_refused(tmp_path):
    with pytest.raises(DeepringError, match=r"none\.csv: cannot be read"):
        read_results(tmp_path / "none.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DeepringError, match="is not UTF-8 text"):
        read_results(tmp_path / "binary.csv")


@pytest.mark.parametrize("text", ["1_0", "٣", "0x10", "1" * 5000])
def test_numbers_are_those_that_are_written(tmp_path, text):
    path = tmp_path / "results.csv"
    write_results(path, [EXAMPLE])
    lines = path.read_text(encoding="utf-8").split("\n")
    values = lines[1].split(",")
    for column, name in enumerate(COLUMNS):
        if column >= 4:
            row = ",".join([*values[:column], text, *values[column + 1 :]])
            path.write_text(f"{lines[0]}\n{row}\n", encoding="utf-8")
            with pytest.raises(DeepringError, match=rf"line 2: {name}: .*, expected a") as caught:
                read_results(path)
            assert len(str(caught.value)) < 500
