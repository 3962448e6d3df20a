"""The tutorials, as a reader follows them: every command and block, and what is shown of them."""

import re
import tomllib

import pytest
from docsite.generated import ROOT

from helpers.pages import DOCS, Block, blocks_of, commands_in, expect_output, follow

TUTORIALS = sorted(f"tutorials/{path.name}" for path in (DOCS / "tutorials").glob("*.md"))


@pytest.mark.docs
@pytest.mark.parametrize("page", [page for page in TUTORIALS if "index" not in page])
def test_a_tutorial_can_be_followed(page, tmp_path):
    follow(page, tmp_path)


@pytest.mark.parametrize("page", TUTORIALS)
def test_every_block_is_a_file_a_command_or_python(page):
    for block in blocks_of(page):
        if block.language == "console":
            assert commands_in(block.text)
        elif block.language == "python":
            compile(block.text, page, "exec")
        else:
            assert block.title or block.language == "text" or page.endswith("index.md")


def test_the_extras_that_the_docs_install_exist():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    texts = [path.read_text("utf-8") for path in DOCS.rglob("*.md")]
    named = re.findall(r"pip install '?(?:deepring|\.)\[([\w,]+)\]", "\n".join(texts))
    assert len(named) > 5
    for extras in named:
        assert set(extras.split(",")) <= set(project["optional-dependencies"]), extras


def test_blocks_are_found_with_titles_and_within_lists(monkeypatch, tmp_path):
    first = '# A\n\n```python title="x.py"\na = 1\n```\n'
    second = "\n## B\n\n- c\n\n    ```console\n    $ d\n    e\n    ```\n"
    (tmp_path / "a.md").write_text(first + second)
    monkeypatch.setattr("helpers.pages.DOCS", tmp_path)
    first, second = blocks_of("a.md")
    assert first == Block("python", "x.py", "a = 1\n", 4)
    assert second == Block("console", "", "$ d\ne\n", 12)
    assert blocks_of("a.md", "B") == [second]
    assert blocks_of("a.md", language="python") == [first]


def test_a_command_goes_over_lines_and_has_its_output():
    assert commands_in("$ a b \\\n    c\nout\n$ d\n") == [("a b      c", "out\n"), ("d", "")]
    with pytest.raises(AssertionError, match="expected a command"):
        commands_in("out\n$ a\n")


@pytest.mark.parametrize("shown", ["a 1.00 b", "a ... b", "... b", "a ...", "a 1.02\n b"])
def test_what_is_shown_is_what_was_printed(shown):
    expect_output(shown, " a   1.00\nb\n", "page:1")


@pytest.mark.parametrize(
    "shown", ["a 1.00", "a 1.4 b", "b ...", "a ... c", "a1.00 b", "... a", "a 1.00 b c"]
)
def test_what_is_shown_and_was_not_printed_fails(shown):
    with pytest.raises(AssertionError, match="page:1"):
        expect_output(shown, " a   1.00\nb\n", "page:1")
