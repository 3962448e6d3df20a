"""The messages that docs/troubleshooting.md quotes are those of the sources."""

import ast
import re

import pytest
from docsite.generated import ROOT

_TEXTS = {ast.Constant: lambda node: node.value, ast.FormattedValue: lambda _: "…"}


def texts_in(source):
    """Every text of a Python source; an f-string has ``…`` for each of its values."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.JoinedStr):
            yield "".join(_TEXTS[type(part)](part) for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def pieces_of(message):
    """What stands between the ``…`` of a quoted message, in its order."""
    return [piece.strip() for piece in message.split("…") if len(piece.strip()) > 1]


def is_said(pieces, text):
    return re.search(".*?".join(map(re.escape, pieces)), text, re.DOTALL) is not None


def quoted():
    page = (ROOT / "docs" / "troubleshooting.md").read_text("utf-8")
    table = page.partition("## Messages")[2].partition("\n## ")[0]
    return re.findall(r"^\| `([^`]+)` \|", table, re.MULTILINE)


@pytest.fixture(scope="module")
def texts():
    files = (ROOT / "src" / "deepring").rglob("*.py")
    return [text for file in files for text in texts_in(file.read_text("utf-8"))]


@pytest.mark.parametrize("message", quoted())
def test_a_message_of_the_page_is_in_the_sources(message, texts):
    assert max(map(len, pieces_of(message))) > 12, f"{message}: too short to be found again"
    assert any(is_said(pieces_of(message), text) for text in texts), message


def test_the_page_has_a_table_of_messages():
    assert 12 <= len(quoted()) == len(set(quoted()))


@pytest.mark.parametrize(
    ("message", "found"),
    [
        ("scan …: 3 is no number", True),
        ("…is no number; expected one", True),
        ("scan …: 4 is no number", False),
        ("is no number… scan", False),
    ],
)
def test_pieces_are_found_in_their_order_within_one_text(message, found):
    source = "f'scan {name}: 3 ' f'is no number; expected one'\n'scan a: 4'"
    assert any(is_said(pieces_of(message), text) for text in texts_in(source)) is found
