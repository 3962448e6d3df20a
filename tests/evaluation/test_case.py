"""What a case is called, in words and in files."""

from dataclasses import FrozenInstanceError, replace

import pytest

from deepring.errors import DeepringError
from deepring.evaluation.case import Case

CASE = Case("DeepRING", "sim_nclt", "sim_mulran", "whole")


def test_it_says_who_was_tested_where():
    assert str(CASE) == "DeepRING trained on sim_nclt, tested on sim_mulran whole"
    assert str(replace(CASE, train="")) == "DeepRING, tested on sim_mulran whole"
    assert CASE.place == "sim_mulran whole"
    assert replace(CASE, region="").place == "sim_mulran"


def test_its_columns_are_in_the_order_of_files():
    assert CASE.columns == {
        "method": "DeepRING",
        "train": "sim_nclt",
        "test": "sim_mulran",
        "region": "whole",
    }
    assert list(CASE.columns) == ["method", "train", "test", "region"]


@pytest.mark.parametrize(
    ("train", "in_domain", "crosses"),
    [
        ("sim_nclt", False, True),
        ("sim_mulran", True, False),
        ("sim_nclt+sim_mulran", False, False),
        ("", False, False),
    ],
)
def test_in_domain_and_crossing_depend_on_the_training(train, in_domain, crosses):
    case = replace(CASE, train=train)
    assert (case.in_domain, case.crosses) == (in_domain, crosses)


def test_file_names_leave_the_training_out_and_other_characters():
    case = Case("Scan Context (20/60)", "x", "a.b", "../up")
    assert case.file_name(".csv") == "Scan_Context_20_60___a_b___up.csv"


def test_cases_are_equal_sorted_and_hashed_by_their_texts_and_cannot_be_changed():
    assert replace(CASE) == CASE
    assert len({CASE, replace(CASE)}) == 1
    assert sorted([CASE, replace(CASE, method="A")])[0].method == "A"
    with pytest.raises(FrozenInstanceError):
        CASE.method = "RING"


@pytest.mark.parametrize("text", ["two\nlines", "\x07", 3, None])
@pytest.mark.parametrize("name", ["method", "train", "test", "region"])
def test_text_that_a_line_cannot_hold_is_refused(name, text):
    with pytest.raises(DeepringError, match=f"{name}: .*expected a str without control"):
        replace(CASE, **{name: text})
