"""`deepring train --help`: every group, every option, and nothing heavy imported for it."""

import re
import subprocess
import sys

import pytest

from deepring.cli.main import main
from deepring.experiment.config_groups import config_folder, group_options


@pytest.mark.parametrize("command", ["train", "evaluate"])
@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_help_lists_the_groups_and_their_options(command, flag, capsys):
    with pytest.raises(SystemExit, match="0"):
        main([command, flag])
    text = capsys.readouterr().out
    assert text.startswith(f"usage: deepring {command}")
    words = set(re.findall(r"[\w/]+", text))
    for group, options in group_options(config_folder()).items():
        if command == "train" or group not in ("sweep", "variant"):
            assert {group, *options} <= words
    assert "sim_nclt*" in text
    assert ("deepring*" in text) == (command == "train")  # evaluate takes what a checkpoint holds
    assert max(map(len, text.splitlines())) <= 100


def test_help_imports_nothing_that_composes_or_trains():
    code = (
        "import sys; from deepring.cli.main import main\n"
        "try: main(['train', '--help'])\nexcept SystemExit: pass\n"
        "print(*{'torch', 'lightning', 'hydra', 'omegaconf', 'matplotlib', 'numpy'} "
        "& set(sys.modules), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.split() == []
