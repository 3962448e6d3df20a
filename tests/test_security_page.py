"""docs/security.md names tests that exist, each beside its claim."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "security.md"


def named_tests():
    """Files and tests in the page's order; ``::test_x`` is one of the file named before it."""
    file = ""
    for path, test in re.findall(
        r"`(tests/[\w/]+\.py)?(?:::(test_\w+))?`", PAGE.read_text("utf-8")
    ):
        file = path or file
        if path or test:
            yield file, test


def test_the_tests_that_the_page_names_exist():
    named = list(named_tests())
    assert len(named) > 25
    for file, test in named:
        tree = ast.parse((ROOT / file).read_text("utf-8"))
        tests = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert not test or test in tests, f"{file}::{test}"
