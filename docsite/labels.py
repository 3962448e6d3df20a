"""Links whose label is a file's name, as a code host shows them, labelled by the page's title."""

import posixpath
import re
from collections.abc import Mapping

_LINK = re.compile(r"\[[\w/.-]+\.md\]\(([\w/.-]+\.md)(#[\w-]+)?\)")


def with_titles(markdown: str, page: str, titles: Mapping[str, str]) -> str:
    """``markdown`` with the titles of pages in the place of their files' names.

    Args:
        markdown: of a page.
        page: its path below docs/.
        titles: of the pages, by their paths below docs/. Links to others stay as they are.

    >>> with_titles("See [b.md](../b.md#c).", "a/a.md", {"b.md": "Bears"})
    'See [Bears](../b.md#c).'
    """

    def labelled(link: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join(posixpath.dirname(page), link[1]))
        return f"[{titles[path]}]({link[1]}{link[2] or ''})" if path in titles else link[0]

    return _LINK.sub(labelled, markdown)
