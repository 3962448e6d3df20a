"""Commands in the docs exist: their options parse, their groups and options are those of conf/."""

import re
import shlex

import pytest

from deepring.cli.commands import COMMANDS, command_line
from deepring.experiment.config_groups import config_folder, group_options
from helpers.pages import DOCS


def commands():
    """(page, command) for each line of docs/ and the README that begins with ``deepring``."""
    for file in [DOCS.parent / "README.md", *sorted(DOCS.rglob("*.md"))]:
        text = re.sub(r" *\\\n *", " ", file.read_text(encoding="utf-8"))
        for line in re.findall(
            r"^(?: {4}|\$ (?:\w+=\S+ )?|)(deepring [a-z-]+ .*)$", text, re.MULTILINE
        ):
            command = re.split(r"  +#| #|  +\(| > | \| ", line)[0].strip()
            _, name, *words = command.split()
            dots = {"...", "…"} & {*words}  # in the place of what a reader writes
            if name in COMMANDS and not dots and " [--" not in command:
                yield pytest.param(command, id=f"{file.name}: {command}"[:100])


@pytest.fixture(scope="module")
def parser():
    return command_line()


@pytest.fixture(scope="module")
def groups():
    return group_options(config_folder())


@pytest.mark.parametrize("command", list(commands()))
def test_the_options_of_a_command_in_the_docs_exist(command, parser, groups, capsys):
    try:
        args = parser.parse_args(shlex.split(command)[1:])
    except SystemExit:
        pytest.fail(f"{command}: {capsys.readouterr().err}")
    for word in getattr(args, "overrides", []):
        key, _, option = word.lstrip("+~").partition("=")
        group = key.partition("@")[0]
        if group in groups and option and option not in OWN:
            for each in option.strip("[]").split(","):
                assert each in groups[group], f"{command}: {word}"


@pytest.mark.parametrize("command", list(commands()))
def test_no_shell_reads_the_words_of_a_command_otherwise(command):
    """zsh takes brackets for names of files, and ~ for homes: such words stand in quotes."""
    bare = re.sub(r"'[^']*'|\"[^\"]*\"", "", command)
    assert not re.search(r"[][~*?{}()]", bare), command


#: Options that a page tells its reader to write.
OWN = ("mine", "partners", "info_nce")
