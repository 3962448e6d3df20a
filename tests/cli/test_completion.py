"""`deepring completion`: scripts that shells can read, and what bash completes with one."""

import shutil
import subprocess

import pytest

from deepring.cli.commands import COMMANDS
from deepring.data.readers import reader_names
from deepring.experiment.config_groups import config_folder, group_options
from helpers.cli import deepring, refused

#: Prints, on a line each, what bash offers for each line of words; the last word is completed.
OFFER = """
source "$1"
while read -ra words; do
  COMP_WORDS=("${words[@]//@/}"); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); COMPREPLY=()
  _shtab_deepring 2> /dev/null
  echo "${COMPREPLY[*]}"
done
"""


@pytest.fixture(scope="module")
def offered(tmp_path_factory):
    """What bash offers for lines of words; ``@`` stands for an empty last word."""
    folder = tmp_path_factory.mktemp("completion")
    script = folder / "deepring.bash"
    script.write_text(deepring("completion", "bash", cwd=folder).stdout)

    def offer(*lines):
        done = subprocess.run(
            ["bash", "-c", OFFER, "bash", str(script)],
            input="\n".join(lines) + "\n",
            capture_output=True,
            text=True,
            check=True,
            cwd=folder,
        )
        assert not done.stderr
        return [set(line.split()) for line in done.stdout.splitlines()]

    (folder / "street.map").write_text("")
    (folder / "drives").mkdir()
    return offer


def test_bash_completes_commands_options_choices_and_files(offered):
    commands, inner, options, choices, formats, maps = offered(
        "deepring @",
        "deepring map @",
        "deepring localize --a",
        "deepring localize --as j",
        "deepring data check --format @",
        "deepring map info str",
    )
    assert commands >= set(COMMANDS)
    assert inner == {"build", "info", "calibrate", "merge"}
    assert options == {"--accumulate", "--as"}
    assert choices == {"json", "jsonl"}
    assert formats == set(reader_names())
    assert maps == {"street.map"}


def test_bash_completes_the_groups_of_configs_and_their_options(offered):
    groups, options, begun = offered(
        "deepring train sampl",
        "deepring train sampling = @",
        "deepring evaluate seed=1 method = deep",
    )
    known = group_options(config_folder())
    assert groups == {f"sampling={option}" for option in known["sampling"]}
    assert options >= set(known["sampling"])
    assert begun == {option for option in known["method"] if option.startswith("deep")}


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_each_script_names_every_command_and_nothing_of_this_machine(shell, tmp_path):
    done = deepring("completion", shell, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert all(command in done.stdout for command in COMMANDS)
    assert str(config_folder()) not in done.stdout
    if shutil.which(shell):
        checked = subprocess.run(
            [shell, "-n"], check=False, input=done.stdout, text=True, capture_output=True
        )
        assert checked.returncode == 0, checked.stderr


def test_another_shell_is_refused(tmp_path):
    refused(deepring("completion", "powershell", cwd=tmp_path), "'powershell', expected one of")
