"""The generated reference says what the code says: commands, config keys, public names."""

import argparse
import dataclasses
import re
from dataclasses import dataclass
from importlib import import_module

import pytest
from docsite.api_pages import api_pages
from docsite.command_pages import command_pages, options, subparsers
from docsite.config_files import comments_of, head_of
from docsite.config_pages import config_pages, rows_of
from docsite.equations import with_mathml
from docsite.markdown import fenced
from docsite.parameters import arguments_in, comments_in, parameters, sentences_about
from docsite.sources import with_sources

import deepring
from deepring.cli.commands import COMMANDS, command_line
from deepring.data.dataset import DatasetConfig
from deepring.experiment.config_groups import config_folder, group_options
from deepring.methods.registry import packaged_methods
from deepring.rasters import RASTERS
from deepring.simulation.settings import SimulationSettings


def leaves(parser):
    inner = subparsers(parser)
    return [leaf for each in inner.values() for leaf in leaves(each)] if inner else [parser]


def test_every_option_of_every_command_is_on_its_page():
    pages = command_pages()
    assert set(pages) == {f"reference/commands/{name}.md" for name in ["index", *COMMANDS]}
    for parser in leaves(command_line()):
        page = pages[f"reference/commands/{parser.prog.split()[1]}.md"]
        section = page.partition(f"# {parser.prog}\n")[2].partition("\n## ")[0]
        for action in options(parser):
            for flag in action.option_strings:
                assert f"`{flag}" in section, f"{parser.prog} {flag}"


def test_a_help_text_is_no_markup_but_for_code(monkeypatch):
    from docsite.command_pages import _escaped

    assert _escaped("a*b_c <d> [e] `f*g`") == "a\\*b\\_c \\<d> \\[e\\] `f*g`"


def test_a_page_states_whether_an_option_is_required_and_its_values():
    from docsite.command_pages import _page

    parser = argparse.ArgumentParser("deepring x", add_help=False)
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="where (%(default)s)")
    parser.add_argument(
        "--as", dest="form", choices=["a", "b"], default="a", help="%(default)s | b"
    )
    parser.add_argument("--fast", action="store_true")
    page = "\n".join(_page(parser))
    assert "| `-o FILE`, `--output FILE` | where (None); required |" in page
    assert "| `--as {a,b}` | a \\| b |" in page
    assert "| `--fast` |  |" in page


def test_every_public_name_has_its_docstring_in_one_page():
    listed = re.findall(r"^::: ([\w.]+)$", "\n".join(api_pages().values()), re.MULTILINE)
    public = [f"{module}.{name}" for name, module in deepring._MODULES.items()]
    assert sorted(set(listed) & set(public)) == sorted(public)
    assert len(listed) == len(set(listed))


@dataclass
class Base:
    #: Metres,
    #: along the road.
    spacing: float = 1.0


@dataclass
class Settings(Base):
    """Settings.

    Args:
        width: of the first layer,
            in channels.
    """

    width: int = 8
    depth: int | None = None  # of the network
    names: list[str] = dataclasses.field(default_factory=lambda: ["a"])
    """What is made."""
    bare: bool = False


def test_the_arguments_of_a_class_with_what_its_source_says_of_them():
    found = parameters(Settings)
    assert [tuple(each) for each in found.values()] == [
        ("float", 1.0, "Metres, along the road."),
        ("int", 8, "of the first layer, in channels."),
        ("int | None", None, "of the network"),
        ("list[str]", ["a"], "What is made."),
        ("bool", False, ""),
    ]
    assert arguments_in("None here.") == {}
    assert comments_in("class A:\n    x: int = 0\n    y: int = 1  # y\n") == {"y": "y"}


def test_a_config_node_has_a_row_for_each_value_and_for_what_its_class_adds():
    node = {"_target_": "x", "width": 4, "inner": {"a": [1, 2]}}
    described = {name: parameters(Settings)[name] for name in ("width", "depth")}
    rows = rows_of("method", node, described, {"method.inner.a": "of a | b"})
    assert rows == [
        ["`method._target_`", "`x`", "`str`", "the class"],
        ["`method.width`", "`4`", "`int`", "of the first layer, in channels."],
        ["`method.inner.a`", "`[1, 2]`", "`list`", "of a \\| b"],
        ["`method.depth`", "`null`", "`int | None`".replace("|", "\\|"), "of the network"],
    ]


def test_comments_of_a_config_file_belong_to_its_keys(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text(
        "# @package _global_\n# deepring train loss=a\n# What it is,\n# in two lines.\n"
        "a: 1 # one\nb:\n  # above\n  c: '#' # behind\n  d: [1,\n    2] # over lines\n"
    )
    assert comments_of(file) == {"a": "one", "b.c": "behind", "b.d": "over lines"}
    assert comments_of(file, "x.y")["x.y.a"] == "one"
    assert head_of(file) == "`deepring train loss=a`\n\nWhat it is, in two lines."


def test_every_option_of_a_file_says_what_it_is():
    folder = config_folder()
    for group, names in group_options(folder).items():
        for name in names:
            file = folder / group / f"{name}.yaml"
            assert not file.is_file() or head_of(file), f"{file} begins without a comment"


def test_all_keys_of_the_schema_and_all_knobs_are_found():
    assert set(parameters(DatasetConfig)) == {f.name for f in dataclasses.fields(DatasetConfig)}
    knobs = parameters(SimulationSettings)
    assert knobs["seed"].comment == "drives, parked cars, moving objects, noise"


def classes_with_keys():
    """The classes whose arguments are keys of the config, by the files of conf/ that name them."""
    texts = [file.read_text(encoding="utf-8") for file in config_folder().rglob("*.yaml")]
    named = set(re.findall(r"_target_: (deepring\.[\w.]+)", "\n".join(texts)))
    methods = map(named_class, packaged_methods().values())
    yield from (getattr(method, "settings_class", method) for method in methods)
    yield from RASTERS.values()
    # Those of Lightning's own classes are theirs to say; those that conf/ gives have comments.
    own = map(named_class, sorted(named))
    yield from (cls for cls in own if not of_lightning(cls))


def of_lightning(cls):
    return any(base.__module__.startswith("lightning.") for base in getattr(cls, "__mro__", ()))


def named_class(path):
    module, _, name = path.rpartition(".")
    return getattr(import_module(module), name)


def test_every_argument_that_is_a_key_says_what_it_is():
    silent = [
        f"{cls.__module__}.{cls.__qualname__}.{name}"
        for cls in classes_with_keys()
        for name, each in parameters(cls).items()
        if not each.comment and name not in ("raster", "preprocessing")
    ]
    assert silent == []


@pytest.mark.docs
def test_every_key_of_the_pages_says_what_it_is():
    rows = [
        (path, line)
        for path, page in config_pages().items()
        for line in page.splitlines()
        if re.match(r"\| `[a-z_]", line)
    ]
    assert len(rows) > 1000
    assert [row for row in rows if re.search(r"(?<!\\)\|\s*\|$", row[1])] == []


def test_what_a_docstring_says_in_prose_of_an_argument_is_found():
    text = """Cells.

    Cells are ``width`` metres across, with a
    ``grid`` below. Nothing else. The ``width`` matters. And the ``width`` again.

    >>> f("``grid``.")
    """
    assert sentences_about(text, "width") == (
        "Cells are ``width`` metres across, with a ``grid`` below. The ``width`` matters."
    )
    assert sentences_about(text, "height") == ""


def test_a_doctest_in_a_docstring_becomes_a_block():
    assert fenced("A.\n\n>>> f(1)\n2\n\nB.") == "A.\n\n```pycon\n>>> f(1)\n2\n```\n\nB."
    assert fenced("    >>> f(\n    ...     1)\n    2\n") == (
        "    ```pycon\n    >>> f(\n    ...     1)\n    2\n    ```\n"
    )


def test_a_page_shows_the_code_of_a_function_without_its_docstring():
    page = with_sources("A\n<!-- source: deepring.core.arrays:real_array -->\n")
    assert "def real_array(" in page
    assert '"""' not in page
    assert page.startswith("A\n```python title=")


@pytest.mark.docs
def test_equations_become_mathml():
    page = with_mathml('<p><span class="arithmatex">\\(a &lt; \\tau\\)</span></p>')
    assert "<math" in page
    assert "<mo>&#x0003C;</mo>" in page
    with pytest.raises(ValueError, match="is no LaTeX"):
        with_mathml('<span class="arithmatex">\\(a_b_c\\)</span>')
