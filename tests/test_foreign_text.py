"""Foreign text as it is printed, and values as messages show them."""

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import DataError, FileError
from deepring.text import printable, printable_lines, shown

ANY_TEXT = st.text(st.characters())  # lone surrogates, too


@given(ANY_TEXT)
def test_what_is_printable_prints_on_one_line_and_stays_what_it_is(text):
    once = printable(text)
    assert once.isprintable()
    assert printable(once) == once
    assert once == text if text.isprintable() else len(once) > len(text)
    once.encode()


@pytest.mark.parametrize(
    "hidden",
    [
        "\x1b[2J",
        "\x9b31m",
        "\r",
        "\n",
        "\0",
        "\x7f",
        "\u202e",
        "\u2066",
        "\u200b",
        "\u2028",
        "\ud800",
    ],
)
def test_what_a_terminal_would_obey_is_escaped(hidden):
    assert hidden not in printable(f"a{hidden}b")
    assert printable(f"a{hidden}b").startswith("a\\")


@given(ANY_TEXT)
def test_lines_stay_lines(text):
    lines = printable_lines(text).split("\n")
    assert lines == [printable(line) for line in text.split("\n")]


@given(ANY_TEXT, ANY_TEXT)
def test_messages_of_errors_are_one_line_each(message, line):
    assert str(FileError(message)).isprintable()
    assert str(DataError(message, lines=[line])).split("\n") == [
        printable(message),
        printable(line),
    ]
    assert len(str(FileError(message * 5000))) < 5000


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda some: (
        st.lists(some, max_size=3) | st.dictionaries(st.text(max_size=3), some, max_size=3)
    ),
    max_leaves=8,
)


@given(values)
def test_small_values_are_shown_as_they_are(value):
    if len(repr(value)) <= 500:
        assert shown(value, 500) == repr(value)


def aliases(levels):
    value = [0]
    for _ in range(levels):
        value = [value] * 9
    return value


@settings(deadline=None)
@given(values | st.just(10**9000) | st.just(aliases(40)) | st.just("x" * 10**7), st.integers(8, 90))
def test_values_of_any_size_are_shown_in_short(value, length):
    start = time.process_time()
    assert len(shown(value, length)) <= max(length, 12)
    assert time.process_time() - start < 1


def test_a_list_that_holds_itself_is_shown():
    value: list = [1]
    value.append(value)
    assert shown(value, 100)
