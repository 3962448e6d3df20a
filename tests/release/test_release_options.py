"""The options of `python -m release`."""

import pytest
from release.__main__ import arguments


def test_the_folder_of_environments_is_made(tmp_path):
    folder = tmp_path / "a" / "b"
    assert arguments(["--folder", str(folder)]).folder == folder
    assert folder.is_dir()


def test_a_folder_that_cannot_be_made_is_one_error(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    with pytest.raises(SystemExit) as ended:
        arguments(["--folder", str(tmp_path / "file" / "b")])
    assert ended.value.code == 2
    assert "expected a folder that is there or can be made" in capsys.readouterr().err
