"""A grid of texts: what each way of writing it keeps, and what stands out."""

import csv as csv_format
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from deepring.errors import DeepringError
from deepring.reports.table import Cell, Table, best_bold, csv, latex, markdown
from deepring.reports.terminal_table import terminal


def grid(rows, headers=("what", "R@1"), names=1, **kwargs):
    return Table("a title", headers, rows, names, **kwargs)


def printed(*grids, width=100):
    console = Console(file=io.StringIO(), width=width)
    console.print(terminal(grids))
    return console.file.getvalue()


def bold(texts, *best):
    return [cell.bold for cell in best_bold(texts, *best)]


def test_the_best_shown_number_is_bold_and_ties_all_are():
    assert bold(["0.5", "0.9", "0.90"]) == [False, True, True]
    assert bold(["0.5", "0.9"], min) == [True, False]
    assert bold(["0.8 ± 0.5", "0.9 ± 0.1"]) == [False, True], "the mean decides"
    assert bold(["0.5", "0.9"], None) == [False, False]


def test_one_number_alone_has_nothing_to_beat():
    assert bold(["0.9"]) == [False]
    assert bold(["-", "0.9", "-"]) == [False, False, False]
    assert bold(["-", "0.0", "0.9"], min) == [False, True, False], "a missing one is not 0"


@given(st.lists(st.floats(0, 1), min_size=2))
def test_bold_are_exactly_those_equal_to_the_maximum(values):
    texts = [f"{value:.3f}" for value in values]
    assert bold(texts) == [text == max(texts) for text in texts]


def test_a_row_of_another_length_is_refused():
    with pytest.raises(DeepringError, match=r"rows\[1\]: 1 cells; expected one per header, 2"):
        grid([[Cell("a"), Cell("1")], [Cell("b")]])


def test_markdown_escapes_bars_and_lists_notes():
    text = markdown([grid([[Cell("a|b"), Cell("1", bold=True)]], notes=["a note"])])
    assert text == "a title\n\n| what | R@1 |\n| --- | ---: |\n| a\\|b | **1** |\n\n- a note\n"


HIDDEN = "a\x1b[2J\nb\u202ec"


def test_what_does_not_print_is_escaped_in_every_form():
    whole = Table(HIDDEN, (HIDDEN, "R@1"), [[Cell(HIDDEN), Cell("1")]], 1, notes=[HIDDEN])
    for text in (printed(whole), markdown([whole]), latex(whole)):
        assert text.replace("\n", "").isprintable()
    assert len(markdown([whole]).splitlines()) == 7


def test_tags_are_text_in_markdown():
    whole = Table("<i>", ("<b>", "R@1"), [[Cell("<script>"), Cell("1")]], 1, notes=["<img>"])
    for line in markdown([whole]).splitlines():
        assert "<" not in line.replace(r"\<", "")


def test_latex_is_a_booktabs_table():
    rows = [
        [Cell("PG"), Cell("0.834 ± 0.010")],
        [Cell("SG"), Cell("0.859", bold=True)],
    ]
    lines = latex(grid(rows, breaks=[1], notes=["a note"])).splitlines()
    assert lines == [
        r"\begin{table}[t]",
        r"\centering",
        r"\caption{a title}",
        r"\begin{tabular}{lr}",
        r"\toprule",
        r"\textbf{what} & \textbf{R@1} \\",
        r"\midrule",
        r"PG & 0.834 $\pm$ 0.010 \\",
        r"\midrule",
        r"SG & \textbf{0.859} \\",
        r"\bottomrule",
        r"\end{tabular}",
        r"\par\footnotesize a note",
        r"\end{table}",
    ]


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("100 % & #1 of $a_b$", r"100 \% \& \#1 of \$a\_b\$"),
        ("{x}^~", r"\{x\}\textasciicircum{}\textasciitilde{}"),
        ("a\\b", r"a\textbackslash{}b"),
        ("[8, 16] *", r"{[}8, 16] {*}"),
    ],
)
def test_latex_escapes_what_it_would_take_for_a_command(text, written):
    assert f"\n{written} & 1 \\\\\n" in latex(grid([[Cell(text), Cell("1")]]))


@given(st.lists(st.text(st.characters(blacklist_categories=["Cs", "Cc"])), max_size=4))
def test_csv_reads_back(texts):
    rows = [[Cell(text, bold=True), Cell("1")] for text in texts]
    back = list(csv_format.reader(io.StringIO(csv(grid(rows, notes=["not here"])))))
    assert back == [["what", "R@1"], *([text, "1"] for text in texts)]


def test_the_terminal_shows_texts_as_they_are_and_rules_between_groups():
    rows = [[Cell(f"[bold]{k}"), Cell("1")] for k in range(3)]
    plain, ruled = printed(grid(rows)), printed(grid(rows, breaks=[1], notes=["a [note]"]))
    assert "[bold]0" in plain
    assert "a [note]" in ruled
    between = ruled[ruled.index("[bold]0") : ruled.index("[bold]1")]
    assert between.count("\n") == 2
    assert plain[plain.index("[bold]0") : plain.index("[bold]1")].count("\n") == 1


def test_a_table_that_fits_is_on_one_line_a_row():
    rows = [[Cell("a method"), Cell("0.859 ± 0.010 (.80-.91)")]]
    assert "a method  0.859 ± 0.010 (.80-.91)" in printed(grid(rows), width=80)


def test_on_a_narrow_terminal_what_follows_a_number_comes_below_it():
    rows = [[Cell("a method of a long name"), *[Cell("0.859 ± 0.010 (.80-.91)")] * 3]] * 2
    table = grid(rows, headers=("what", "one", "two", "three"), breaks=[1])
    lines = [line.rstrip() for line in printed(table, width=60).splitlines()]
    assert max(map(len, lines)) <= 60
    shown = [line.split() for line in lines]
    first = shown.index(["a", "method", "of", "a", "long", "name", *["0.859"] * 3])
    assert shown[first + 1 : first + 3] == [["±", "0.010"] * 3, [".80-.91"] * 3]
    assert lines[first + 3] == ""  # between the two sections


def test_names_are_broken_where_numbers_leave_little_room():
    rows = [[Cell("Scan Context 120x120"), *[Cell("0.859 (.80-.91)")] * 4]]
    table = grid(rows, headers=("what", *"abcd"))
    assert max(map(len, printed(table, width=48).splitlines())) <= 48
    assert "Scan" in printed(table, width=48)
    assert "…" not in printed(table, width=48)


def test_titles_and_notes_keep_to_the_width():
    rows = [[Cell("a"), Cell("1")]]
    table = Table("a title " * 12, ("what", "R@1"), rows, 1, notes=["a note " * 20])
    assert max(map(len, printed(table, width=60).splitlines())) <= 60
