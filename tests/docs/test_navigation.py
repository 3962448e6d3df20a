"""Every page of docs/ has its place in the site, and folders fill themselves."""

import pytest
import yaml
from docsite.generated import ROOT
from docsite.navigation import fill_folders, pages_in, title_of


def test_every_page_stands_in_the_navigation_once():
    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text("utf-8"))["nav"]
    files = {p.relative_to(ROOT / "docs").as_posix(): p for p in (ROOT / "docs").rglob("*.md")}
    generated = ["examples", "reference/commands", "reference/config", "reference/python"]
    pages = {path: file.read_text("utf-8") for path, file in files.items()}
    pages |= {f"{folder}/index.md": "# Generated" for folder in generated}
    placed = pages_in(fill_folders(nav, pages))
    assert len(set(placed)) == len(placed)
    missing = set(files) - set(placed)
    assert not missing, f"{missing}: in no place of the navigation; mkdocs.yml has it"


def test_a_folder_is_its_pages_the_index_first_and_others_by_title():
    pages = {
        "a/z.md": "# Apple",
        "a/b.md": "text\n# `Pear`",
        "a/index.md": "# All",
        "a/c/d.md": "# D",
    }
    nav = [{"Fruit": "a/"}, "home.md", {"Further": [{"Same": "a/c/"}]}]
    filled = fill_folders(nav, pages)
    assert filled == [
        {"Fruit": ["a/index.md", {"Apple": "a/z.md"}, {"Pear": "a/b.md"}]},
        "home.md",
        {"Further": [{"Same": [{"D": "a/c/d.md"}]}]},
    ]
    assert pages_in(filled) == ["a/index.md", "a/z.md", "a/b.md", "home.md", "a/c/d.md"]


def test_a_folder_without_pages_is_refused():
    with pytest.raises(ValueError, match=r"the folder b/, which has no page"):
        fill_folders([{"B": "b/"}], {"a/index.md": "# A"})


def test_a_page_without_a_heading_is_refused():
    with pytest.raises(ValueError, match="without a heading"):
        title_of("text alone")
