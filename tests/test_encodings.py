"""Text files are UTF-8 whatever the locale says: every call that opens one states it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import deepring

SOURCES = sorted(Path(deepring.__file__).parent.rglob("*.py"))

#: Functions that open a text file, unless told otherwise.
TEXT = ("read_text", "write_text", "open", "fdopen", "savetxt", "NamedTemporaryFile")


def unstated(source: str) -> Iterator[int]:
    """Lines of calls that open text in the locale's encoding."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call) or name_of(node.func) not in TEXT:
            continue
        strings = [a.value for a in node.args if isinstance(a, ast.Constant)]
        mode = next((str(s) for s in strings if set(str(s)) <= set("rwxabt+")), None)
        name, bare = name_of(node.func), isinstance(node.func, ast.Name)
        # Neither `Map.open` nor a function of one's own called `read_text` is Python's.
        opens = not bare if name.endswith("_text") else bare or mode is not None or name != "open"
        stated = any(keyword.arg == "encoding" for keyword in node.keywords)
        if opens and not stated and "b" not in (mode or ""):
            yield node.lineno


def name_of(function: ast.expr) -> str:
    return getattr(function, "attr", getattr(function, "id", ""))


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ("path.read_text()", [1]),
        ("path.write_text(text)", [1]),
        ("open(path)", [1]),
        ("path.open('w', newline='')", [1]),
        ("path.open('wb'); open(path, 'rb'); Map.open(path)", []),
        ("path.read_text(encoding='utf-8'); path.open('r', encoding='utf-8-sig')", []),
    ],
)
def test_a_call_without_an_encoding_is_found(source, lines):
    assert list(unstated(source)) == lines


def test_every_text_file_is_opened_as_utf_8():
    assert len(SOURCES) > 100
    found = [f"{path}:{k}" for path in SOURCES for k in unstated(path.read_text(encoding="utf-8"))]
    assert not found
