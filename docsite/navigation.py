"""The navigation of mkdocs.yml with its folders filled in."""

import re
from collections.abc import Mapping
from typing import Any

Nav = list[Any]
"""Entries as in mkdocs.yml: a path, or {title: path}, or {title: entries}."""


def fill_folders(nav: Nav, pages: Mapping[str, str]) -> Nav:
    """``nav`` with each entry that ends in ``/`` replaced by the pages in that folder.

    Args:
        nav: of mkdocs.yml.
        pages: text of each page by its path below docs/.

    Raises:
        ValueError: an entry names a folder that has no page.
    """
    return [_filled(entry, pages) for entry in nav]


def pages_in(nav: Nav) -> list[str]:
    """The paths that a navigation without folders names, in order."""
    paths = []
    for entry in nav:
        value = next(iter(entry.values())) if isinstance(entry, Mapping) else entry
        paths += pages_in(value) if isinstance(value, list) else [value]
    return paths


def title_of(text: str) -> str:
    """The first heading of a page, without its markup."""
    heading = re.search(r"^# +(.+)$", text, re.MULTILINE)
    if heading is None:
        raise ValueError(f"a page without a heading begins {text[:60]!r}")
    return re.sub(r"[`*]", "", heading[1]).strip()


def _filled(entry: Any, pages: Mapping[str, str]) -> Any:
    if not isinstance(entry, Mapping):
        return entry
    ((title, value),) = entry.items()
    if isinstance(value, list):
        return {title: fill_folders(value, pages)}
    return {title: _folder(value, pages)} if value.endswith("/") else entry


def _folder(folder: str, pages: Mapping[str, str]) -> Nav:
    inside = [path for path in pages if path.rpartition("/")[0] == folder.rstrip("/")]
    if not inside:
        raise ValueError(f"mkdocs.yml: nav has the folder {folder}, which has no page")
    first = [path for path in inside if path.endswith("/index.md")]
    titles = {path: title_of(pages[path]) for path in inside if path not in first}
    others = sorted(titles, key=lambda path: titles[path].lower())
    return [*first, *({titles[path]: path} for path in others)]
