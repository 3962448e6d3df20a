"""The examples in docstrings are true."""

import doctest
import importlib
import inspect
import re
from pathlib import Path

import pytest

import deepring

SOURCE = Path(deepring.__file__).parents[1]


def examples(path):
    return len(re.findall(r"^ *>>> ", path.read_text(), re.MULTILINE))


MODULES = {
    ".".join(path.relative_to(SOURCE).with_suffix("").parts): examples(path)
    for path in sorted(Path(deepring.__file__).parent.rglob("*.py"))
    if examples(path)
}


class Finder(doctest.DocTestFinder):
    """Finds examples behind decorators, such as those that check shapes, as well."""

    def _from_module(self, module, object):
        return super()._from_module(module, inspect.unwrap(object))


@pytest.mark.parametrize("name", MODULES)
def test_examples(name):
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    for test in Finder().find(importlib.import_module(name)):
        runner.run(test)
    outcome = runner.summarize(verbose=False)
    assert outcome.failed == 0
    assert outcome.attempted == MODULES[name]  # none is overlooked
