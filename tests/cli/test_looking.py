"""`--page`, `--view` and `--view-file`: pages and scenes of maps, located scans and loops."""

import html
import json
import sys
from functools import partial

import numpy as np
import pytest
import yaml

from deepring.reports import viewer
from helpers.cli import deepring, refused
from helpers.html_pages import row_of
from helpers.small_maps import GROUND_Z, PLACES, pose, seen_at, small_map

COMMANDS = (
    ("map", "info", "a.map"),
    ("map", "build", "drive.yaml", "-o", "b.map"),
    ("localize", "a.map", "scans"),
    ("loops", "drive.yaml", "-o", "out"),
)


@pytest.fixture
def here(tmp_path):
    """A folder with a map, scans and a drive, in which commands run."""
    small_map().save(tmp_path / "a.map")
    (tmp_path / "scans").mkdir()
    stops = [(x, y, yaw + 0.1) for x, y, yaw in PLACES]
    for k, stop in enumerate(stops):
        np.save(tmp_path / "scans" / f"{k}<b>.npy", seen_at(*stop).astype(np.float32))
    rows = [pose(*stop, z=10.0)[:3].ravel() for stop in stops]
    np.savetxt(tmp_path / "poses.txt", rows)
    drive = {"scans": "scans", "poses": "poses.txt", "sensor_height": -GROUND_Z}
    (tmp_path / "drive.yaml").write_text(yaml.safe_dump(drive))
    return partial(deepring, cwd=tmp_path)


@pytest.fixture
def scenes(monkeypatch):
    """What would be saved and shown: scenes, and the files of those that are saved."""
    seen = []
    monkeypatch.setattr(viewer, "rerun", lambda _="view": None)
    monkeypatch.setattr(viewer, "expect_display", lambda: None)
    monkeypatch.setattr(viewer, "view", lambda scene: seen.append((scene, None)))
    monkeypatch.setattr(viewer, "save_view", lambda scene, path: seen.append((scene, path.name)))
    return seen


def test_maps_have_pages(here, tmp_path):
    done = here("map", "build", "drive.yaml", "-o", "b.map", "--spacing", 5, "--page", "b.html")
    assert done.returncode == 0, done.stderr
    assert "note: written b.html" in done.stderr
    page = (tmp_path / "b.html").read_text()
    for line in done.stdout.splitlines():
        assert html.escape(line[13:]) in page  # the facts are those that are printed
    assert "2&lt;b&gt;.npy, number 2" in page
    assert "http" not in page
    assert here("map", "info", "a.map", "--page", "a.html").returncode == 0
    assert "drive &lt;b&gt;one" in (tmp_path / "a.html").read_text()


def test_located_scans_have_a_page_beside_the_table(here, tmp_path):
    np.save(tmp_path / "scans" / "3.npy", np.full((50, 3), 5000.0))
    done = here("localize", "a.map", "scans", "--as", "jsonl", "--page", "a.html")
    assert done.returncode == 1
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    page = (tmp_path / "a.html").read_text()
    for row in rows:
        assert f"<td>{row['x']:.2f}</td><td>{row['y']:.2f}</td>" in page
    assert row_of("refused", 1) in page
    assert "Errors beside" not in page
    assert "<b>" not in page
    refused(here("localize", "a.map", "scans/3.npy", "--page", "b.html"), "world coordinates")
    assert not (tmp_path / "b.html").exists()  # nothing was located


def test_a_drive_s_own_poses_are_compared_with(here, tmp_path):
    done = here("localize", "a.map", "drive.yaml", "--as", "jsonl", "--page", "a.html")
    assert done.returncode == 0, done.stderr
    off = [
        np.hypot(row["x"] - x, row["y"] - y)
        for row, (x, y, _) in zip(map(json.loads, done.stdout.splitlines()), PLACES, strict=True)
    ]
    page = (tmp_path / "a.html").read_text()
    assert "Errors beside the true poses" in page
    for metres in off:
        assert f"<td>{metres:.2f}</td>" in page


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_views_are_shown_and_written(command, here, scenes):
    done = here(*command, "--view", "--view-file", "a.rrd")
    assert done.returncode == 0, done.stderr
    (scene, file), (shown, window) = scenes
    assert file == "a.rrd"
    assert window is None
    assert shown is scene
    paths = {shape.path for shape in scene.shapes}
    expected = {
        "map info a.map": {"map/places", "map/points"},
        "map build drive.yaml": {"map/places", "map/points", "map/path"},
        "localize a.map scans": {"map/places", "scan/points", "scan/position"},
        "loops drive.yaml -o": {"odometry/trajectory", "odometry/keyframes"},
    }
    assert expected[" ".join(command[:3])] <= paths


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_what_cannot_be_is_refused_before_the_work(command, here, tmp_path, monkeypatch):
    before = sorted(path.name for path in tmp_path.iterdir())
    (tmp_path / "old.html").write_text("kept")
    (tmp_path / "old.rrd").write_text("kept")
    monkeypatch.setitem(sys.modules, "rerun", None)
    missing = ": rerun is not installed, expected it; run pip install 'deepring[view]'"
    refused(here(*command, "--view"), f"--view{missing}")
    refused(here(*command, "--view-file", "new.rrd"), f"--view-file{missing}")
    refused(here(*command, "--view-file", "old.rrd"), "--view-file: old.rrd exists")
    refused(here(*command, "--view-file", "new.map"), "expected a name that ends in .rrd")
    if command[0] != "loops":  # which writes its page in any case
        refused(here(*command, "--page", "old.html"), "--page: old.html exists")
        refused(here(*command, "--page", "old.html/x.html"), "--page: old.html/x.html cannot be")
        refused(here(*command, "--page", "new.txt"), "--page: new.txt, expected a name that ends")
    assert (tmp_path / "old.html").read_text() == (tmp_path / "old.rrd").read_text() == "kept"
    after = sorted(path.name for path in tmp_path.iterdir())
    assert after == sorted([*before, "old.html", "old.rrd"])


def test_two_outputs_cannot_be_one_file(here):
    command = ("map", "build", "drive.yaml", "-o", "b.html", "--page", "b.html")
    refused(here(*command), "--page: b.html is another output too")
