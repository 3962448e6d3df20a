"""What mkdocs calls while it builds: pages out of the code, the navigation, equations, links."""

import re
from typing import Any

from mkdocs.structure.files import File

from docsite.equations import with_mathml
from docsite.generated import generated_pages
from docsite.labels import with_titles
from docsite.navigation import fill_folders, title_of
from docsite.sources import with_sources

#: Of the pages, by their paths; known once the files are.
_titles: dict[str, str] = {}

_TABLE = re.compile(r"(<table>.*?</table>)", re.DOTALL)


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages, and fill the folders of the navigation."""
    for path, text in generated_pages().items():
        files.append(File.generated(config, path, content=text))
    pages = {file.src_uri: file.content_string for file in files if file.src_uri.endswith(".md")}
    config.nav = fill_folders(config.nav, pages)
    _titles.update((path, title_of(text)) for path, text in pages.items() if "\n# " in f"\n{text}")
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links out of docs/ to the site's own pages, name them, and set in shown sources."""
    up = "../" * page.file.src_uri.count("/")
    for name in ("CONTRIBUTING.md", "CHANGELOG.md"):
        markdown = markdown.replace(f"](../{up}{name})", f"]({up}{name.lower()})")
    return with_sources(with_titles(markdown, page.file.src_uri, _titles))


def on_page_content(html: str, **_: Any) -> str:
    """Turn equations into MathML, and let wide tables scroll."""
    return _TABLE.sub(r'<div class="wide">\1</div>', with_mathml(html))
