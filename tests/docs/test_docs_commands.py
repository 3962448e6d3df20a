"""Commands in the docs exist: their options parse, their groups and options are those of conf/."""

import re
import shlex

import pytest

from deepring.cli.commands import COMMANDS
from deepring.cli.main import parse
from deepring.experiment.config_groups import config_folder, group_options
from helpers.pages import DOCS


def commands():
    """(page, command) for each line of docs/ and the README that begins with ``deepring``."""
    for file in [DOCS.parent / "README.md", *sorted(DOCS.rglob("*.md"))]:
        text = re.sub(r" *\\\n *", " ", file.read_text(encoding="utf-8"))
        for line in re.findall(
            r"^(?: {4}|\$ (?:\w+=\S+ )?|)(deepring [a-z-]+ .*)$", text, re.MULTILINE
        ):
            command = re.split(r"  +#| #|  +\(| > ", line)[0].strip()
            words = set(command.split())
            if words & {*COMMANDS} and not words & {"...", "…"} and " [--" not in command:
                yield pytest.param(command, id=f"{file.name}: {command}"[:100])


@pytest.mark.parametrize("command", list(commands()))
def test_the_options_of_a_command_in_the_docs_exist(command, capsys):
    words = shlex.split(command)[1:]
    try:
        args = parse(words)
    except SystemExit:
        pytest.fail(f"{command}: {capsys.readouterr().err}")
    groups = group_options(config_folder())
    for word in getattr(args, "overrides", []):
        group, _, option = word.lstrip("+~").partition("=")
        if group.partition("@")[0] in groups and option and option not in OWN:
            for each in option.strip("[]").split(","):
                assert each in groups[group.partition("@")[0]], f"{command}: {word}"


#: Options that a page tells its reader to write.
OWN = ("mine", "partners", "info_nce")
