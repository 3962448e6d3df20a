"""Tables: what is shown, what is bold, and what is refused."""

import io
from dataclasses import replace

import pytest
from rich.console import Console

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.reports.results_table import (
    markdown,
    markdown_radii,
    recall,
    render,
    render_radii,
)
from helpers.results import result_of


def result(method, recall_1=0.5, *, train="", test="nclt", radius=10.0, query_s=0.002):
    rates = (recall_1, 0.9, 0.8, 0.7)
    seconds = 0.0123, query_s
    return result_of(Case(method, train, test, "test"), radius, rates=rates, seconds=seconds)


def shown(table, *, colour=False, width=120):
    system = "standard" if colour else None
    console = Console(file=io.StringIO(), width=width, force_terminal=colour, color_system=system)
    console.print(table)
    return console.file.getvalue()


def cells(text, method):
    """Column to cell of a method's row in Markdown."""
    lines = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("|")]
    row = next(line for line in lines[2:] if line[0].strip() == method)
    return {k.strip(): v.strip() for k, v in zip(lines[0], row, strict=True)}


def test_the_best_of_each_column_is_bold():
    text = markdown([result("RING", 0.6), result("DeepRING", 0.9, query_s=0.004)])
    assert cells(text, "RING")["R@1"] == "0.600 (.46-.72)"
    assert cells(text, "DeepRING")["R@1"] == "**0.900 (.79-.96)**"
    assert cells(text, "RING")["ms/query"] == "**2**", "the fastest is the best"
    assert cells(text, "DeepRING")["ms/query"] == "4"


def test_equal_to_the_last_digit_shown_is_equally_good():
    text = markdown([result("a", 0.90001), result("b", 0.9), result("c", 0.5)])
    assert cells(text, "a")["R@1"] == cells(text, "b")["R@1"] == "**0.900 (.79-.96)**"


def test_only_results_of_one_test_region_compete_and_one_alone_does_not():
    alone = result("RING", 0.95, test="mulran")
    text = markdown([result("a", 0.6), alone, result("b", 0.7)])
    assert cells(text, "b")["R@1"] == "**0.700 (.56-.81)**"
    assert cells(text, "RING")["R@1"] == "0.950 (.85-.98)"
    first, second = text.index("nclt test:"), text.index("mulran test:")
    assert first < text.index("| a |") < text.index("| b |") < second < text.index("| RING |")


def test_counted_over_all_queries_the_unanswerable_ones_weigh():
    one = result("RING", 0.8)
    assert recall(one, "recall_1", "answerable") == 0.8
    assert recall(one, "recall_1", "all") == 0.4
    row = cells(markdown([one], over="all"), "RING")
    assert (row["R@1"], row["R@5"], row["AUC"]) == (
        *("0.400 (.31-.50)", "0.450 (.36-.55)"),
        "0.700",
    )
    assert "recall over all queries" in markdown([one], over="all")


def test_render_shows_the_same_numbers_in_the_terminal():
    results = [result("RING", 0.6), result("DeepRING", 0.9, train="nclt")]
    plain = shown(render(results))
    assert "nclt test: right within 10 m, recall over answerable queries" in plain
    for value in ("RING", "DeepRING", "50/100", "0.600", "0.900 (.79-.96)", "12.3"):
        assert value in plain
    assert "\x1b[1m0.900 (.79-.96)\x1b[0m" in shown(render(results), colour=True)


def test_eighty_columns_are_enough():
    names = ("Scan Context 20x60 + pose re-ranking", "DeepRING", "a-name-without-any-blank-in-it")
    train = "+".join(f"campus_{k}" for k in range(120, 139))
    some = [result(name, 1.0, train=train, test="campus_110") for name in names]
    radii = [replace(one, radius_m=r, wrong_beyond_m=r) for one in some for r in (10.0, 5.0, 25.0)]
    radii += [replace(one, radius_m=r, wrong_beyond_m=r) for one in some for r in (15.0, 20.0)]
    for table in (render(some), render_radii(radii)):
        text = shown(table, width=80)
        assert max(map(len, text.splitlines())) <= 80
        assert "…" not in text
        for value in ("pose", "campus_120", "18", "more", "1.000", ".93-1.00"):
            assert value in text


def test_a_grey_zone_is_told_and_results_with_another_one_do_not_compete():
    plain = result("a", 0.6, radius=3.0)
    text = markdown([plain, replace(plain, wrong_beyond_m=20.0)], radius=3.0)
    assert "nclt test: right within 3 m, recall over" in text
    assert "nclt test: right within 3 m, wrong beyond 20 m, recall over" in text
    assert "**" not in text


def test_of_all_queries_the_interval_is_that_of_more_queries():
    one = result("RING", 1.0)
    assert cells(markdown([one]), "RING")["R@1"] == "1.000 (.93-1.00)"
    assert cells(markdown([one], over="all"), "RING")["R@1"] == "0.500 (.40-.60)"


def test_only_the_asked_radius_is_shown():
    text = markdown([result("near", radius=5.0), result("far", radius=25.0)], radius=25.0)
    assert "far" in text
    assert "near" not in text


def test_radii_stand_side_by_side():
    results = [result("RING", r / 40, radius=r) for r in (10.0, 5.0, 25.0)]
    text = markdown_radii([*results, result("DeepRING", 0.9)])
    assert text.startswith("nclt test: Recall@1 over answerable queries, right within\n\n|")
    row = {"method": "RING", "trained on": "-"}
    assert cells(text, "RING") == {
        **row,
        "5 m": "0.125 (.06-.24)",
        "10 m": "0.250 (.15-.38)",
        "25 m": "0.625 (.49-.75)",
    }
    other = cells(text, "DeepRING")
    assert (other["5 m"], other["10 m"]) == ("-", "**0.900 (.79-.96)**")
    lines = [line.split() for line in shown(render_radii(results), width=60).splitlines()]
    assert ["RING", "-", "0.125", "0.250", "0.625"] in lines
    assert [".06-.24", ".15-.38", ".49-.75"] in lines
    assert cells(markdown_radii(results, over="all"), "RING")["25 m"].startswith("0.312")


def test_names_are_shown_as_they_are():
    odd = result("ring[bold]|x")
    assert "ring[bold]|x" in shown(render([odd]))
    assert r"| ring[bold]\|x |" in markdown([odd])


def test_times_have_three_digits_and_no_exponent():
    assert cells(markdown([result("RING", query_s=12.345)]), "RING")["ms/query"] == "12300"
    assert cells(markdown([result("RING", query_s=1.2345e-6)]), "RING")["ms/query"] == "0.00123"


@pytest.mark.parametrize("table", [render, markdown])
def test_a_radius_without_results_names_those_there_are(table):
    with pytest.raises(DeepringError, match=r"radius: 7 m, expected one of 5, 10,"):
        table([result("a"), result("b", radius=5.0)], radius=7.0)
    with pytest.raises(DeepringError, match="expected one of none"):
        table([])


def test_other_misuse_is_refused():
    with pytest.raises(DeepringError, match="over: 'some'"):
        markdown([result("a")], over="some")
    with pytest.raises(DeepringError, match="name: 'recall_3'"):
        recall(result("a"), "recall_3", "all")
    with pytest.raises(DeepringError, match="results: none, expected"):
        markdown_radii([])
