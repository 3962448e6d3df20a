"""`import deepring`: the public names, each in its place, and nothing heavy until it is used."""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import deepring

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", deepring.__all__)
def test_each_name_is_that_of_its_module(name):
    value = getattr(deepring, name)
    if name != "__version__":
        assert value is getattr(importlib.import_module(deepring._MODULES[name]), name)
        assert value.__module__.startswith(deepring._MODULES[name])
        assert value.__doc__


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'DeepRang'"):
        _ = deepring.DeepRang
    assert not hasattr(deepring, "__path_to_nowhere__")


def test_type_checkers_see_the_same_names():
    tree = ast.parse(Path(deepring.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    imports = {alias.asname: node.module for node in block.body for alias in node.names}
    assert imports == deepring._MODULES


def test_the_docs_list_the_same_names():
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    names = re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)
    assert sorted(names) == sorted(deepring.__all__)


def test_dir_shows_the_public_names_and_no_helper():
    assert dir(deepring) == sorted(deepring.__all__)


def test_the_citation_has_the_package_s_version():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {deepring.__version__}\n" in text


def test_importing_the_package_imports_nothing_else():
    code = "import sys, deepring; dir(deepring); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name for name in done.stdout.split() if name.startswith("deepring")}
    assert loaded == {"deepring"}
    assert not {"torch", "numpy"} & set(done.stdout.split())
