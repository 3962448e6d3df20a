"""The pages that are made out of the repository at each build, and never committed."""

from pathlib import Path

from docsite.api_pages import api_pages
from docsite.command_pages import command_pages
from docsite.config_pages import config_pages
from docsite.example_pages import example_pages

ROOT = Path(__file__).resolve().parents[1]

_REFERENCE = """\
# Reference

Made out of the code at each build, so that it is never behind it.

- [Commands](commands/index.md): every command and its options
- [Config keys](config/index.md): every key of a config, its default, its type, what it is
- [Python](python/index.md): the public names and their docstrings
- [Public names](../api.md): the same names in one table
- [Changes](../changelog.md): what changed from version to version
"""


def generated_pages() -> dict[str, str]:
    """The Markdown of each generated page by its path below docs/."""
    return {
        "reference/index.md": _REFERENCE,
        **command_pages(),
        **config_pages(),
        **api_pages(),
        **example_pages(ROOT / "examples"),
        "contributing.md": _of_root("CONTRIBUTING.md"),
        "changelog.md": _of_root("CHANGELOG.md"),
    }


def _of_root(name: str) -> str:
    """A page of the repository's root, with its links into docs/ as the site has them."""
    return (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")
