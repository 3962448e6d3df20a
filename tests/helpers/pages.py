"""Pages of docs/ as their readers use them: their blocks, and what comes of following them."""

import contextlib
import io
import re
import runpy
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from helpers.cli import deepring

DOCS = Path(__file__).resolve().parents[2] / "docs"

_FENCE = re.compile(r"^( *)```(\w*)([^\n]*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")


class Block(NamedTuple):
    """What stands between two fences."""

    language: str
    title: str
    """The name of the file that the reader is to write; empty for what is to be run."""
    text: str
    line: int
    """Of its first line on the page."""


def blocks_of(page: str, heading: str = "", language: str = "") -> list[Block]:
    """The blocks of a page of docs/, or of the section below a heading of it."""
    text = (DOCS / page).read_text(encoding="utf-8")
    begin, end = 0, len(text)
    if heading:
        begin = text.index(f"\n## {heading}\n")
        end = text.find("\n## ", begin + 1) % (len(text) + 1)
    found = [
        Block(
            match[2],
            (re.search(r'title="([^"]+)"', match[3]) or ["", ""])[1],
            re.sub(rf"^{match[1]}", "", match[4], flags=re.MULTILINE),
            text.count("\n", 0, match.start()) + 2,
        )
        for match in _FENCE.finditer(text, begin, end)
    ]
    return [block for block in found if language in ("", block.language)]


def follow(page: str, folder: Path) -> None:
    """Do what a tutorial says, block after block, in a folder.

    Files are written (a block with a title), Python is run in one session, commands are run, and
    what they print is compared with what the page shows.
    """
    names = {"__name__": "__main__"}
    for block in blocks_of(page):
        where = f"{page}:{block.line}"
        if block.title:
            file = folder / block.title
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            with contextlib.chdir(folder):
                printed = _printed(compile(block.text, where, "exec"), names)
        elif block.language == "text":  # what the Python above it prints
            expect_output(block.text, printed, where)
        else:
            assert block.language == "console", f"{where}: a block of {block.language!r}"
            for command, shown in commands_in(block.text):
                expect_output(shown, run_command(command, folder, where), f"{where}: {command}")


def commands_in(text: str) -> list[tuple[str, str]]:
    """The commands of a console block, each with the output below it."""
    parts = re.split(r"^\$ ", text.replace("\\\n", " "), flags=re.MULTILINE)
    assert not parts[0].strip(), f"a console block begins with {parts[0]!r}, expected a command"
    return [(command, shown) for command, _, shown in (part.partition("\n") for part in parts[1:])]


def run_command(command: str, folder: Path, where: str) -> str:
    """What a command of a tutorial prints; it has to succeed."""
    command, _, file = command.partition(" > ")
    words = shlex.split(command)
    with _on_path(folder, words):
        match words:
            case ["deepring", *arguments]:
                done = deepring(*arguments, cwd=folder)
                assert done.returncode == 0, f"{where}: {command}\n{done.stdout}{done.stderr}"
                output = done.stdout
            case ["python", script]:
                with contextlib.chdir(folder):
                    output = _printed_by(Path(script))
            case ["pip", "install", *_]:  # held against pyproject.toml by a test
                output = ""
            case _:
                raise AssertionError(f"{where}: {command}: expected deepring, python FILE, or pip")
    if file:
        (folder / file).write_text(output, encoding="utf-8")
    return "" if file else output


@contextlib.contextmanager
def _on_path(folder: Path, words: list[str]) -> Iterator[None]:
    """Take PYTHONPATH=. from the words of a command, and let it import from the folder."""
    path = list(sys.path)
    if words[0] == "PYTHONPATH=.":
        words.pop(0)
        sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path[:] = path
        for name, module in list(sys.modules.items()):
            if Path(getattr(module, "__file__", None) or "/").is_relative_to(folder):
                del sys.modules[name]


def expect_output(shown: str, printed: str, where: str) -> None:
    """What a page shows is what was printed: ``...`` is any text, and numbers are near.

    Numbers differ by at most 5 % or 2 units of their last digit: other processors round otherwise.
    """
    parts = [part.split() for part in shown.split("...")]
    words, at = printed.split(), 0
    for number, part in enumerate(parts):
        tries = range(at, at + 1 if number == 0 else len(words) - len(part) + 1)
        found = next((i for i in tries if _alike(part, words[i : i + len(part)])), None)
        assert found is not None, f"{where}: expected {' '.join(part)!r} in\n{printed}"
        at = found + len(part)
    assert not parts[-1] or at == len(words) or not shown, f"{where}: more was printed\n{printed}"


def _alike(expected: list[str], printed: list[str]) -> bool:
    return len(expected) == len(printed) and all(map(_same, expected, printed))


def _same(expected: str, printed: str) -> bool:
    if _NUMBER.sub("0", expected) != _NUMBER.sub("0", printed):
        return False
    return all(
        abs(float(a) - float(b)) <= max(0.05 * abs(float(a)), 2 * 10.0 ** -_digits(a))
        for a, b in zip(_NUMBER.findall(expected), _NUMBER.findall(printed), strict=True)
    )


def _digits(number: str) -> int:
    return len(number.partition(".")[2])


def _printed(code, names) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(code, names)
    return out.getvalue()


def _printed_by(script: Path) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as out:
        runpy.run_path(str(script), run_name="__main__")
    return out.getvalue()
