"""The docs as a site: built without a network or a warning; every link leads somewhere."""

import logging
import socket
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from docsite.generated import ROOT, generated_pages

pytestmark = pytest.mark.docs

#: Elements that a browser fetches by itself, and the attribute that says from where.
_FETCHED = {
    "script": "src",
    "img": "src",
    "link": "href",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "object": "data",
}


class Page(HTMLParser):
    """The anchors of a page, its links, and what a browser fetches for it."""

    def __init__(self, path):
        super().__init__()
        self.anchors, self.links, self.fetched = {""}, [], []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.anchors |= {values[key] for key in ("id", "name") if values.get(key)}
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])
        if tag in _FETCHED and values.get(_FETCHED[tag]):
            self.fetched.append(values[_FETCHED[tag]])


class Warned(logging.Handler):
    """Keeps the warnings of a log."""

    def __init__(self):
        super().__init__(logging.WARNING)
        self.lines = []

    def emit(self, record):
        self.lines.append(record.getMessage())


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the built site. Whatever asks for the network fails the build."""
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    folder, warned = tmp_path_factory.mktemp("site"), Warned()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(socket.socket, "connect", _refuse)
        patch.setattr(socket, "getaddrinfo", _refuse)
        patch.setenv("NO_MKDOCS_2_WARNING", "1")
        patch.chdir(ROOT)
        logging.getLogger("mkdocs").addHandler(warned)
        config = load_config("mkdocs.yml", site_dir=str(folder), strict=True)
        config.plugins.on_startup(command="build", dirty=False)
        build(config)
    assert not warned.lines
    return folder


def _refuse(*_):
    raise AssertionError("the build asked for the network")


@pytest.fixture(scope="module")
def pages(site):
    """All but 404.html, whose addresses are a server's."""
    files = sorted(set(site.rglob("*.html")) - {site / "404.html"})
    return {path.resolve(): Page(path) for path in files}


def test_every_page_of_docs_and_every_generated_page_is_built(site):
    sources = [path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")]
    for source in [*sources, *generated_pages()]:
        assert (site / source).with_suffix(".html").is_file(), source


def test_every_link_leads_to_a_page_or_file_and_every_anchor_is_there(pages):
    broken = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = _target(path, parts.path)
            if not target.is_file():
                broken.append(f"{path.name}: {link}")
            elif target in pages and unquote(parts.fragment) not in pages[target].anchors:
                broken.append(f"{path.name}: {link}: no such anchor")
    assert not broken, "\n".join(broken)
    assert sum(len(page.links) for page in pages.values()) > 1000


def test_a_browser_fetches_nothing_from_elsewhere(pages, site):
    for path, page in pages.items():
        for address in page.fetched:
            parts = urlsplit(address)
            assert not parts.netloc, f"{path.name}: {address}"
            assert parts.scheme in ("", "data"), f"{path.name}: {address}"
            if not parts.scheme:
                assert _target(path, parts.path).is_file(), f"{path.name}: {address}"
    for style in site.rglob("*.css"):
        assert "url(http" not in style.read_text("utf-8").replace('"', ""), style.name


def test_code_and_equations_are_set(pages, site):
    equations = (site / "equations.html").read_text("utf-8")
    assert equations.count("<math") > 12
    assert "def row_dft_magnitude" in (site / "equations.html").read_text("utf-8").replace(
        '<span class="k">', ""
    ).replace("</span>", "").replace('<span class="w">', "").replace('<span class="nf">', "")
    assert "arithmatex" not in equations
    assert not any("```" in path.read_text("utf-8") for path in site.rglob("*.html"))


def _target(page: Path, path: str) -> Path:
    if not path:
        return page
    target = (page.parent / unquote(path)).resolve()
    return target / "index.html" if target.is_dir() else target
