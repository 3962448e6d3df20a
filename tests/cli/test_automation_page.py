"""docs/automation.md: its schemas and its exit statuses are those of the commands."""

import re
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

from deepring.cli import main as entry
from deepring.cli.mistakes import BUG, MISTAKE
from deepring.cli.stop_signals import INTERRUPTED, TERMINATED
from deepring.data.readers import binary_formats
from deepring.data.readers.custom.custom_scans import UP
from deepring.data.readers.custom.drive_file import _KEYS, read_drives
from deepring.errors import DeepringError
from deepring.schemas import read_schema, schema_names
from helpers.cli import deepring, refused

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "automation.md").read_text(encoding="utf-8")


def rows(heading):
    """The first two cells of each row of the tables below a heading of the page."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    return re.findall(r"^\| ([^|]+?) \| (.+?) \|$", section, re.MULTILINE)


def test_the_page_lists_every_schema():
    named = [name.strip("`") for name, _ in rows("Results as JSON") if name.startswith("`")]
    assert sorted(named) == schema_names()


def test_the_page_lists_every_status():
    listed = {int(status) for status, _ in rows("Exit statuses") if status.isdigit()}
    assert listed == {0, 1, MISTAKE, BUG, INTERRUPTED, TERMINATED}


def test_a_schema_is_printed_as_its_file_is(tmp_path):
    listed = deepring("schema", cwd=tmp_path).stdout.split()
    assert listed == schema_names()
    printed = deepring("schema", "results", cwd=tmp_path).stdout
    assert yaml.safe_load(printed) == read_schema("results")
    refused(
        deepring("schema", "result", cwd=tmp_path), "NAME: 'result', expected one of case_study"
    )


def test_a_bug_is_a_traceback_with_a_status_of_its_own(monkeypatch, capsys):
    def broken(_):
        raise KeyError("a bug")

    monkeypatch.setattr(entry, "run", broken)
    with pytest.raises(SystemExit) as stopped:
        entry.main(["schema"])
    assert stopped.value.code == BUG
    told = capsys.readouterr().err
    assert "Traceback" in told
    assert "KeyError: 'a bug'" in told
    assert "deepring doctor" in told


def test_ctrl_c_has_a_status_of_its_own(monkeypatch, capsys):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(entry, "run", interrupted)
    with pytest.raises(SystemExit) as stopped:
        entry.main(["schema"])
    assert stopped.value.code == INTERRUPTED
    assert capsys.readouterr().err == "interrupted\n"


#: Files that describe drives, and whether they may.
DRIVES = [
    ("scans: a\nsensor_height: 1.7\n", True),
    ("name: town\nscans: a\nsensor_height: 1.7\nformat: kitti\nposes: p.txt\n", True),
    ("scans: a\nsensor_height: 2\nup: -z\nworld_up: sensor\npose_format: tum\n", True),
    ("scans: a\nsensor_height: 2\nz_band: [-1, 3]\nazimuth: [90, 270]\nrange: [2, 60]\n", True),
    ("scans: a\nsensor_height: 2\nsensor_in_body: [1,0,0,0, 0,1,0,0, 0,0,1,0]\n", True),
    ("scans: a\nsensor_height: 2\nsensor_in_body: [[1,0,0,0],[0,1,0,0],[0,0,1,0]]\n", True),
    ("scans: a\nsensor_height: 2\nposes:\n", True),
    ("sensor_height: 2\ndrives: {one: {scans: a}, two: {scans: b, up: y}}\n", True),
    ("sensor_height: 2\n", False),
    ("scans: a\n", False),
    ("scans: 7\nsensor_height: 2\n", False),
    ("scans: ' '\nsensor_height: 2\n", False),
    ("scans: a\nsensor_height: 0\n", False),
    ("scans: a\nsensor_height: 2\nheight: 2\n", False),
    ("scans: a\nsensor_height: 2\nup: w\n", False),
    ("scans: a\nsensor_height: 2\nformat: las\n", False),
    ("scans: a\nsensor_height: 2\nrange: [-1, 3]\n", False),
    ("scans: a\nsensor_height: 2\nz_band: [1]\n", False),
    ("scans: a\nsensor_height: 2\nsensor_in_body: [1, 2, 3]\n", False),
    ("drives: {}\n", False),
    ("- scans\n", False),
]


@pytest.mark.parametrize(("text", "good"), DRIVES)
def test_the_schema_of_drive_yaml_says_what_its_reader_says(text, good, tmp_path):
    path = tmp_path / "drive.yaml"
    path.write_text(text)
    try:
        read_drives(path)
        read = True
    except DeepringError:
        read = False
    assert Draft202012Validator(read_schema("drive_file")).is_valid(yaml.safe_load(text)) is good
    assert read is good


def test_the_schema_of_drive_yaml_has_the_keys_and_choices_of_the_reader():
    keys = read_schema("drive_file")["$defs"]["keys"]["properties"]
    assert set(keys) == set(_KEYS)
    assert keys["format"]["enum"] == [*sorted(binary_formats()), None]
    assert set(keys["up"]["enum"]) == {*UP, None}
    assert set(keys["world_up"]["enum"]) == {*UP, "sensor", None}


def test_the_drives_of_the_docs_are_of_the_schema():
    validator = Draft202012Validator(read_schema("drive_file"))
    blocks = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    custom = (DOCS / "custom_data.md").read_text(encoding="utf-8")
    blocks += re.findall(r"```yaml\n# drive.yaml\n(.*?)```", custom, re.DOTALL)
    assert len(blocks) >= 2
    for block in blocks:
        assert validator.is_valid(yaml.safe_load(block)), block
