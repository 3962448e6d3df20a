"""Tables as files: each is written whole, and its path printed."""

from pathlib import Path

from deepring.cli.console import console
from deepring.io.files import replacing
from deepring.reports.table import Table, latex, markdown

_WHAT = {".md": "table", ".tex": "latex", ".csv": "numbers"}


def write_shown(name: str, table: Table, folder: Path) -> None:
    """Write a table as Markdown and as LaTeX."""
    write_text(folder / f"{name}.md", markdown([table]))
    write_text(folder / f"{name}.tex", latex(table))


def write_text(path: Path, text: str) -> None:
    """Write a file, and print its path."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace", newline="")
    console.print(f"{_WHAT[path.suffix]:<12} {path}")
