"""The scripts of examples/ run, and print what they are about."""

import ast
import contextlib
import io
import re
import runpy
import sys

import pytest
from docsite.example_pages import example_pages, printed_by
from docsite.generated import ROOT

from deepring.data import readers
from helpers.cli import as_new_process
from helpers.pages import expect_output

EXAMPLES = ROOT / "examples"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the scripts run one after the other: they share the street that they simulate."""
    return tmp_path_factory.mktemp("examples")


def output(name, folder):
    """What a script prints, which is what its page shows."""
    before = dict(readers._registered)
    with as_new_process(folder), contextlib.redirect_stdout(io.StringIO()) as out:
        sys.argv = [name]
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    readers._registered.clear()
    readers._registered.update(before)
    expect_output(printed_by(EXAMPLES / f"{name}.py"), out.getvalue(), f"{name}.txt")
    return out.getvalue()


def test_scans_are_described_and_compared(folder):
    printed = output("describe_and_compare", folder)
    assert re.search(r"turned left by 90° +alike 0\.9\d, heading +90° further left", printed)
    order = [name.strip() for name in printed.partition("most alike first:\n")[2].splitlines()]
    assert order == ["the same scan", "turned left by 90°", "5 m further", "another street"]


def test_scans_are_found_in_a_map(folder):
    printed = output("build_and_query_map", folder)
    median = float(re.search(r"scans are off by less than (\S+) m", printed)[1])
    assert 0 < median < 0.5


def test_a_new_method_stands_beside_ring(folder):
    found = re.findall(r"^(\w+) +finds (\S+) of (\d+) queries", output("new_method", folder), re.M)
    assert [name for name, *_ in found] == ["Rings", "Ring"]
    assert 0 < float(found[0][1]) < float(found[1][1]) < 1


def test_a_new_reader_opens_its_layout(folder):
    printed = output("new_reader", folder)
    assert "monday: 4 scans along 6.0 m" in printed
    assert re.search(r"the third scan occupies 1\d of 14400 cells", printed)


@pytest.mark.docs
def test_a_sweep_prints_its_table(folder):
    printed = output("sweep_and_table", folder)
    runs = re.findall(r"^method_aggregation-(\w+)\+seed-(\d): Recall@1 [01]\.\d\d", printed, re.M)
    assert runs == [("dft", "0"), ("dft", "1"), ("gap", "0"), ("gap", "1")]


@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.py")), ids=lambda file: file.stem)
def test_a_script_is_short_and_says_what_it_is_about(file):
    text = file.read_text("utf-8")
    assert 20 <= len(text.splitlines()) <= 60
    assert len(ast.get_docstring(ast.parse(text)).splitlines()) > 2


def test_every_script_and_notebook_has_a_page_with_its_code():
    pages = example_pages(EXAMPLES)
    for file in [*EXAMPLES.glob("*.py"), *EXAMPLES.glob("*.ipynb")]:
        page = pages[f"examples/{file.stem}.md"]
        assert page.startswith("# ")
        assert f"({file.stem}.md)" in pages["examples/index.md"]
        if file.suffix == ".py":
            assert file.read_text("utf-8").split('"""')[2].strip() in page
            assert printed_by(file) in page
