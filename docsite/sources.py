"""The source of functions, set into pages where these ask for it."""

import importlib
import inspect
import re
import textwrap

_ASKED = re.compile(r"^<!-- source: ([\w.]+):([\w.]+) -->$", re.MULTILINE)


def with_sources(markdown: str) -> str:
    """A page with ``<!-- source: module:name -->`` replaced by that object's code.

    The code comes without its docstring, which the reference has.
    """
    return _ASKED.sub(lambda found: _block(found[1], found[2]), markdown)


def code_of(module: str, name: str) -> str:
    """The code of a function or class, dedented, without its docstring."""
    value = importlib.import_module(module)
    for part in name.split("."):
        value = getattr(value, part)
    source = textwrap.dedent(inspect.getsource(inspect.unwrap(value)))
    return re.sub(r'\n +r?"""(?:.|\n)*?"""(?=\n)', "", source, count=1).rstrip()


def _block(module: str, name: str) -> str:
    path = module.removeprefix("deepring.").replace(".", "/")
    return f'```python title="{path}: {name}"\n{code_of(module, name)}\n```'
