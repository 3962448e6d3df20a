"""Maps from the command line: built, looked at, localised in; each mistake as one clear error."""

import csv
import io
import json
import math
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.readers.nclt import open_nclt
from deepring.localization.location import AcceptanceThresholds
from deepring.localization.map import Map
from deepring.methods.network_file import load_network
from helpers.bags import KINDS, START, message, write_bag
from helpers.cli import SMALL, deepring, refused
from helpers.scenes import scattered

BUILD = ("map", "build")


@pytest.fixture
def here(tmp_path):
    """Runs a command in tmp_path."""
    return partial(deepring, cwd=tmp_path)


@pytest.fixture(scope="module")
def checkpoint(tiny_nclt, tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained")
    done = deepring(
        *("train", "experiment=demo", f"data.root={tiny_nclt}", "evaluate=false", *SMALL),
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    return folder / "outputs" / "demo" / "latest" / "checkpoints" / "last.ckpt"


@pytest.fixture(scope="module")
def place_map(tiny_nclt, checkpoint, tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    options = ["--checkpoint", checkpoint, "--session", "2031-02-04", "--spacing", 5, "--points"]
    done = deepring(*BUILD, tiny_nclt, "-o", "street.map", *options, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "places" in done.stdout
    assert f"points       {Map.open(folder / 'street.map').points.count}" in done.stdout
    return folder / "street.map"


@pytest.fixture(scope="module")
def second(tiny_nclt):
    return open_nclt(tiny_nclt, "2031-03-17")


def test_scans_are_located_as_a_table_json_and_csv(place_map, second, tmp_path, here):
    names = [str(second.files[k]) for k in (0, 3)]
    shown = deepring("localize", place_map, *names, "--format", "nclt", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert "trusted" in shown.stdout
    stems = [second.files[k].stem for k in (0, 3)]  # with endings, long names are too wide
    assert [line.split()[0] for line in shown.stdout.splitlines()] == ["scan", *stems]
    options = ["--format", "nclt", "--as"]
    lines = here("localize", place_map, *names, *options, "jsonl").stdout
    rows = [json.loads(line) for line in lines.splitlines()]
    table = here("localize", place_map, *names, *options, "csv").stdout
    for row, k, other in zip(rows, (0, 3), csv.DictReader(io.StringIO(table)), strict=True):
        assert math.hypot(*(second.positions[k] - [row["x"], row["y"]])) < 5
        assert row["scan"] == other["scan"] == str(second.files[k])
        assert float(other["x"]) == row["x"]


def test_the_whole_pose_is_given_as_a_table_json_and_csv(place_map, second, here):
    names = [str(second.files[k]) for k in (0, 3)]
    options = ["--format", "nclt", "--refine", "--as"]
    lines = here("localize", place_map, *names, *options, "jsonl").stdout
    rows = [json.loads(line) for line in lines.splitlines()]
    table = here("localize", place_map, *names, *options, "csv").stdout
    for row, k, other in zip(rows, (0, 3), csv.DictReader(io.StringIO(table)), strict=True):
        refined, truth = row["refined"], second.poses[k]
        assert refined["converged"]
        assert refined["doubt"] == (None if row["trusted"] else "location")
        pose, covariance = np.array(refined["pose"]), np.array(refined["covariance"])
        assert np.linalg.norm(pose[:3, 3] - truth[:3, 3]) < 0.2
        assert np.degrees(Rotation.from_matrix(truth[:3, :3].T @ pose[:3, :3]).magnitude()) < 0.5
        assert covariance.shape == (6, 6)
        assert np.linalg.eigvalsh(covariance)[0] > 0
        assert other["refined_covariance"].split(" ")[0] == f"{covariance[0, 0]:.9g}"
        assert len(other["refined_covariance"].split(" ")) == 36
        angles = [float(other[f"refined_{name}"]) for name in ("roll", "pitch", "yaw")]
        np.testing.assert_allclose(rotation_from_rpy(*angles), pose[:3, :3], atol=1e-9)
        assert float(other["refined_z"]) == pose[2, 3]
        assert other["refined_doubt"] == (refined["doubt"] or "")
        assert float(other["x"]) == row["x"]  # the location stands beside it
    shown = here("localize", place_map, *names, "--format", "nclt", "--refine").stdout
    assert "roll °" in shown
    assert "unobservable" not in shown


def test_a_tunnel_is_said_to_hold_nothing_along_it(tmp_path, here):
    rng = np.random.default_rng(0)

    def tunnel():
        along, across = rng.uniform(-40, 40, (4, 4000)), rng.uniform(0, 1, (4, 4000))
        far = np.full(4000, 4.0)
        sides = [(8 * across[0] - 4, far - 5.8), (8 * across[1] - 4, far - 1),
                 (far, 4.8 * across[2] - 1.8), (-far, 4.8 * across[3] - 1.8)]  # fmt: skip
        parts = [np.c_[x, y, z] for x, (y, z) in zip(along, sides, strict=True)]
        return np.concatenate(parts) + rng.normal(0, 0.02, (16000, 3))

    place_map = Map(load_network("shipped").method, -1.8, points=True)
    place_map.add([tunnel()], np.eye(4)[None], ["a"])
    place_map.save(tmp_path / "one.map")
    np.save(tmp_path / "scan.npy", tunnel())
    assert "unobservable" in here("localize", "one.map", "scan.npy", "--refine").stdout
    row = json.loads(here("localize", "one.map", "scan.npy", "--refine", "--as", "jsonl").stdout)
    (direction,) = row["refined"]["unobservable"]
    assert direction["name"] in ("along 0°", "along 180°")
    assert row["refined"]["covariance"][0][0] > 0.25
    assert row["refined"]["covariance"][1][1] < 0.01


def test_refining_without_points_or_library_is_refused_before_a_scan_is_read(
    second, tmp_path, here, monkeypatch
):
    for points in (False, True):
        bare = Map(load_network("shipped").method, points=points)
        bare.add([scattered(0)], np.eye(4)[None], ["a"])
        bare.save(tmp_path / f"{points}.map")
    (tmp_path / "broken.pcd").write_text("no scan")
    scan = tmp_path / "broken.pcd"
    refused(here("localize", "False.map", scan, "--refine"), "False.map", "holds no points",
            "map build --points")  # fmt: skip
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    refused(here("localize", "True.map", scan, "--refine"), "pip install 'deepring[refine]'")


def test_trust_is_calibrated_on_another_drive(place_map, tiny_nclt, tmp_path, here):
    drive = [tiny_nclt, "--session", "2031-03-17", "--spacing", 20, "--precision", 0.5]
    done = here("map", "calibrate", place_map, *drive, "-o", "sure.map")
    assert done.returncode == 0, done.stderr
    usual, sure = Map.open(place_map), Map.open(tmp_path / "sure.map", check=True)
    assert sure.thresholds != usual.thresholds
    assert len(sure) == len(usual)
    assert sure.points.count == usual.points.count > 100 * len(sure)
    assert f"{sure.thresholds.fit:g}" in here("map", "info", "sure.map").stdout
    refused(here("map", "calibrate", place_map, *drive, "-o", "sure.map"), "exists")
    drive[-1] = 0.999
    refused(here("map", "calibrate", place_map, *drive, "-o", "b.map"), "no thresholds")


def test_two_maps_are_put_together(place_map, tiny_nclt, checkpoint, second, tmp_path, here):
    options = ["--checkpoint", checkpoint, "--session", "2031-03-17", "--spacing", 5]
    assert here(*BUILD, tiny_nclt, "-o", "b.map", *options).returncode == 0
    done = here("map", "merge", place_map, "b.map", "-o", "both.map")
    assert done.returncode == 0, done.stderr
    assert "agree, to 0." in done.stdout
    assert "only one of the maps keeps them" in done.stderr
    both = Map.open(tmp_path / "both.map", check=True)
    assert len(both) == len(Map.open(place_map)) + len(Map.open(tmp_path / "b.map"))
    frame = done.stdout.partition("frame        ")[2].splitlines()[0]
    x, y, _, yaw = (float(part.split()[1]) for part in frame.split(", "))
    assert math.hypot(x, y) < 1  # the two drives have one world
    assert abs(yaw) < 1
    refused(here("map", "merge", place_map, "b.map", "-o", "both.map"), "exists")
    refused(here("map", "merge", place_map, "absent.map", "-o", "c.map"), "absent.map")


def test_a_map_of_one_place_tells_other_places(tmp_path, here):
    """Nothing else is compared there: a wrong scan's fit of 0.21 to 0.26 was enough for trust."""
    place_map = Map(load_network("shipped").method)
    place_map.add([scattered(0)], np.eye(4)[None], ["a"])
    fits = [place_map.localize(scattered(seed)).fit for seed in range(1, 9)]
    place_map.thresholds = AcceptanceThresholds(fit=min(fits))
    place_map.save(tmp_path / "one.map")
    (tmp_path / "scans").mkdir()
    for seed in range(9):
        np.save(tmp_path / "scans" / f"{seed}.npy", scattered(seed))
    rows = [
        json.loads(line)
        for line in here("localize", "one.map", "scans", "--as", "jsonl").stdout.splitlines()
    ]
    assert [row["trusted"] for row in rows] == [True, *[False] * 8]
    doubts = [row["doubt"] for row in rows]
    assert doubts == [None, *["ratio"] * 8]
    assert all(0.5 < row["ratio"] < 1.41 for row in rows[1:])
    # 672 cells ask for a fit of 0.15, whatever the thresholds.
    place_map.thresholds = AcceptanceThresholds(fit=min(fits), ratio=0.0)
    place_map.save(tmp_path / "any.map")
    table = here("localize", "any.map", "scans").stdout
    assert table.count("cannot tell: few cells") == 8
    csv_rows = csv.DictReader(
        io.StringIO(here("localize", "one.map", "scans", "--as", "csv").stdout)
    )
    assert [row["doubt"] for row in csv_rows] == ["", *doubts[1:]]


def test_a_precision_that_is_no_share_is_refused_before_anything_is_read(here):
    refused(here("map", "calibrate", "no.map", "nowhere", "--precision", 2, "-o", "c.map"), "share")


def test_a_map_is_built_with_the_network_of_the_package(tiny_nclt, second, here):
    done = here(*BUILD, tiny_nclt, "--session", "2031-02-04", "--spacing", 10, "-o", "shipped.map")
    assert done.returncode == 0, done.stderr
    rows = here("localize", "shipped.map", second.files[3], "--format", "nclt", "--as", "jsonl")
    row = json.loads(rows.stdout)
    assert math.hypot(*(second.positions[3] - [row["x"], row["y"]])) < 2
    done = here("export", "shipped", "-o", "again.safetensors")
    assert done.returncode == 0, done.stderr
    refused(here("export", "shipped", "-o", "again.pt"), "again.pt", ".safetensors")


def test_a_folder_of_ones_own_scans(place_map, second, tmp_path, here):
    (tmp_path / "scans").mkdir()
    for k in (0, 1):
        np.save(tmp_path / "scans" / f"{k}.npy", second.points(k))
    done = here("localize", place_map, "scans", "--as", "jsonl")
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 2


def test_a_scan_that_cannot_be_located_does_not_hide_the_others(place_map, second, tmp_path, here):
    good, holes = second.points(0), second.points(1).copy()
    holes[7] = np.nan  # a missing return
    utm = good + np.float32([345_000, 4_037_000, 0])
    for name, points in {"a": good, "b": holes, "c": good[:0], "e": utm}.items():
        np.save(tmp_path / f"{name}.npy", points)
    (tmp_path / "d.npy").write_bytes(b"no scan")
    names = [f"{name}.npy" for name in "abcde"]
    done = here("localize", place_map, *names, "--as", "jsonl")
    assert done.returncode == 1
    assert [json.loads(line)["scan"] for line in done.stdout.splitlines()] == ["a.npy", "b.npy"]
    errors = [line for line in done.stderr.splitlines() if line.startswith("error")]
    assert len(errors) == 3
    assert all(f"{name}.npy" in line for name, line in zip("cde", errors, strict=True))
    assert "look like world coordinates" in errors[2]
    assert here("localize", place_map, *names[2:]).returncode == 2  # none is located


@pytest.mark.parametrize("kind", KINDS)
def test_scans_of_a_bag_are_located(kind, place_map, second, tmp_path, here):
    clouds = [message(second.points(k)) for k in range(4)]
    bag = write_bag(tmp_path, kind, {"/imu": ["none"], "/points": clouds})
    done = here("localize", place_map, bag, "--every", 3, "--as", "jsonl")
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [(row["scan"], row["stamp"]) for row in rows] == [
        (str(bag), START),
        (str(bag), START + 3 * 10**8),
    ]
    for row, k in zip(rows, (0, 3), strict=True):
        assert math.hypot(*(second.positions[k] - [row["x"], row["y"]])) < 5


def test_bags_as_a_user_types_them(place_map, second, tmp_path, here):
    clouds = [message(second.points(k)) for k in range(2)]
    several = write_bag(tmp_path, "bag", {"/left": clouds, "/right": clouds[:1]})
    shown = deepring("localize", place_map, several, "--topic", "/right", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert "drive.bag" in shown.stdout
    localize = ("localize", place_map, several)
    refused(here(*localize), "drive.bag", "/left, /right", "--topic")
    refused(here(*localize, "--topic", "/up"), "no point clouds on topic /up", "/left or /right")
    refused(here(*localize, "--every", 0), "--every: 0")
    several.write_bytes(several.read_bytes()[:-200])
    refused(here(*localize, "--topic", "/left"), "drive.bag", "cut short")
    (tmp_path / "drive.bag").unlink()
    chat = write_bag(tmp_path, "mcap", {"/chat": ["hello"]})
    refused(here("localize", place_map, chat), "/chat (std_msgs/msg/String, 1 message)")
    assert {path.name for path in tmp_path.iterdir()} == {"drive"}


def test_a_bag_of_which_nothing_or_a_part_is_read_is_a_failure(place_map, second, tmp_path, here):
    clouds = [message(second.points(k)) for k in range(2)]
    bag = write_bag(tmp_path, "mcap", {"/points": clouds})
    whole = bag.read_bytes()
    bag.write_bytes(whole[:-20])
    done = here("localize", place_map, bag, "--as", "jsonl")
    assert done.returncode != 0
    assert [json.loads(line)["stamp"] for line in done.stdout.splitlines()] == [
        START,
        START + 10**8,
    ]
    refused(done, "2 messages on /points read", "how many more there were is unknown")
    bag.unlink()
    (bag.parent / "metadata.yaml").unlink()
    bag.parent.rmdir()
    empty = write_bag(tmp_path, "folder", {"/points": []})
    refused(here("localize", place_map, empty), "topic /points has no messages")


def test_what_is_wrong_with_a_message_does_not_hide_those_before(place_map, second, tmp_path, here):
    flat = message(second.points(1))
    flat.fields[0].name = "range"
    empty = message(second.points(1)[:0])
    bag = write_bag(tmp_path, "mcap", {"/points": [empty, message(second.points(0)), flat]})
    np.save(tmp_path / "a.npy", second.points(2))
    done = here("localize", place_map, bag, "a.npy", "--as", "jsonl")
    assert done.returncode == 1
    stamps = [json.loads(line)["stamp"] for line in done.stdout.splitlines()]
    assert stamps == [START + 10**8, None]
    errors = [line for line in done.stderr.splitlines() if line.startswith("error")]
    assert f"{bag}, /points at {START} ns: no points" in errors[0]
    assert f"{bag}, /points at {START + 2 * 10**8} ns: PointCloud2: fields 'range'" in errors[1]


def test_a_sensor_at_another_height_says_where_the_ground_is(place_map, second, tmp_path, here):
    lower = second.points(0) + np.float32([0, 0, 20])
    np.save(tmp_path / "lower.npy", lower)
    np.save(tmp_path / "as_built.npy", second.points(0))
    told = here("localize", place_map, "lower.npy", "--ground-z", 20, "--as", "jsonl")
    usual = here("localize", place_map, "as_built.npy", "--as", "jsonl")
    assert told.returncode == 0, told.stderr
    row, expected = json.loads(told.stdout), json.loads(usual.stdout)
    assert row["fit"] == pytest.approx(expected["fit"], abs=0.02)
    assert math.hypot(row["x"] - expected["x"], row["y"] - expected["y"]) < 0.5
    refused(here("localize", place_map, "lower.npy", "--ground-z", "nan"), "--ground-z: nan")


def test_info_reads_every_byte(place_map, tmp_path, here):
    done = here("map", "info", place_map)
    assert done.returncode == 0
    assert "DeepRING" in done.stdout
    damaged = bytearray(place_map.read_bytes())
    damaged[-9] ^= 1
    (tmp_path / "damaged.map").write_bytes(damaged)
    refused(here("map", "info", "damaged.map"), "damaged.map", "altered")
    refused(here("localize", "damaged.map", place_map), "damaged.map", "altered")
    (tmp_path / "short.map").write_bytes(damaged[:1000])
    refused(here("map", "info", "short.map"), "short.map", "cut short")


def test_mistakes_leave_nothing_behind(place_map, tiny_nclt, checkpoint, tmp_path, here):
    known = ["--checkpoint", checkpoint]
    (tmp_path / "there").write_text("mine")
    refused(here(*BUILD, tiny_nclt, "-o", "there", *known), "exists")
    assert (tmp_path / "there").read_text() == "mine"
    refused(here(*BUILD, tiny_nclt, "-o", "a.map", *known), "the name of one")
    session = ["--session", "2031-02-04"]
    for options, words in (
        (["--spacing", -1, *known, *session], ["--spacing: -1"]),
        (["--checkpoint", "none.ckpt", *session], ["none.ckpt"]),
        ([*known, "--session", "2030-01-01"], ["2030-01-01"]),
    ):
        refused(here(*BUILD, tiny_nclt, "-o", "a.map", *options), *words)
    refused(here("localize", place_map, "nowhere"), "nowhere")
    refused(here("localize", "nothing.map", place_map), "nothing.map")
    assert {path.name for path in tmp_path.iterdir()} == {"there"}


def test_loops_are_written_for_back_ends(tiny_nclt, checkpoint, tmp_path, here):
    options = ["--checkpoint", checkpoint, "--session", "2031-02-04", "--spacing", 8]
    done = here("loops", tiny_nclt, *options, "-o", "out/drive")
    assert done.returncode == 0, done.stderr
    written = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    trajectory = {"drive_odometry.tum", "drive_odometry.kitti"}
    others = {"drive.g2o", "drive.loops.txt", "drive.json", "drive.png", "drive.html"}
    assert set(written) == trajectory | others
    found = json.loads(written["drive.json"])
    assert found["poses"] == "given"
    keyframes = len(found["scans"])
    assert written["drive.g2o"].count(b"VERTEX_SE3:QUAT") == keyframes
    session = open_nclt(tiny_nclt, "2031-02-04")
    rows = [line.split() for line in written["drive_odometry.tum"].decode().splitlines()]
    seconds = [int(row[0].replace(".", "")) for row in rows]
    assert seconds == session.stamps.tolist()
    refined = here("loops", tiny_nclt, *options, "--optimize", "-o", "fine/drive")
    assert refined.returncode == 0, refined.stderr
    assert "refined" in refined.stdout
    assert (tmp_path / "fine" / "drive_optimized.tum").read_text().count("\n") == len(rows)
    refused(here("loops", tiny_nclt, *options, "-o", "out/drive"), "exists")
    wrong = [*options, "--recent", 0]
    refused(here("loops", tiny_nclt, *wrong, "-o", "b"), "recent")
    refused(here("loops", tiny_nclt, *options, "--every", 2, "-o", "b"), "--every: 2")
    assert not list(tmp_path.glob("b*"))


def test_a_network_is_exported_once(checkpoint, tmp_path, here):
    done = here("export", checkpoint, "-o", "network.onnx")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "network.onnx").stat().st_size > 1e5
    refused(here("export", checkpoint, "-o", "network.onnx"), "exists")
    refused(here("export", "none.ckpt", "-o", "b.onnx"), "none.ckpt")
    assert [path.name for path in tmp_path.iterdir()] == ["network.onnx"]


@pytest.fixture
def custom_drive(tiny_nclt, tmp_path):
    """Both drives of the tiny streets in one YAML file, the sensor upside down 1.5 m up."""
    described = {"sensor_height": 1.5, "up": "-z", "pose_format": "tum", "drives": {}}
    for name, date in (("first", "2031-02-04"), ("second", "2031-03-17")):
        session = open_nclt(tiny_nclt, date)
        lifted = session.poses @ pose_from(np.eye(3), [0, 0, 1.5])
        hangs = lifted @ np.diag([1.0, -1, -1, 1])
        turns = Rotation.from_matrix(hangs[:, :3, :3]).as_quat()
        folder = tmp_path / name
        folder.mkdir()
        stamps = session.stamps / 1e9
        np.savetxt(tmp_path / f"{name}.tum", np.column_stack([stamps, hangs[:, :3, 3], turns]))
        for k, points in enumerate(session):
            np.save(folder / f"{k}.npy", (points - np.float32([0, 0, 1.5])) * [1, -1, -1])
        described["drives"][name] = {"scans": name, "poses": f"{name}.tum"}
    path = tmp_path / "drive.yaml"
    path.write_text(yaml.safe_dump(described))
    return path


def test_a_custom_drive_is_taken_wherever_a_dataset_is(
    custom_drive, tiny_nclt, checkpoint, tmp_path, here
):
    checked = here("data", "check", "drive.yaml")
    assert checked.returncode == 0, checked.stderr
    assert {"first", "second"} <= set(checked.stdout.split())
    known = ["--checkpoint", checkpoint]
    built = [*known, "--spacing", 0, "--session"]
    done = here(*BUILD, "drive.yaml", "-o", "custom.map", *built, "first")
    assert done.returncode == 0, done.stderr
    assert "-1.5 m in the scans' frame" in done.stdout
    assert here(*BUILD, tiny_nclt, "-o", "nclt.map", *built, "2031-02-04").returncode == 0
    # The map is that of the drive as its own reader gives it, but for the sensor's height.
    custom, nclt = (Map.open(tmp_path / f"{name}.map") for name in ("custom", "nclt"))
    assert len(custom) == len(nclt) > 50
    lifted = nclt.places.poses @ pose_from(np.eye(3), [0, 0, 1.5])
    np.testing.assert_allclose(custom.places.poses, lifted, atol=1e-9)
    images = [one.places.tensors()["images"] for one in (custom, nclt)]
    assert (images[0] != images[1]).float().mean() < 0.01  # bytes; heights are rounded
    some = ["--session", "second", "--every", 30, "--as", "jsonl"]
    done = here("localize", "custom.map", "drive.yaml", *some)
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    second = open_nclt(tiny_nclt, "2031-03-17")
    assert len(rows) == len(second.files[::30])
    for row, position in zip(rows, second.positions[::30], strict=True):
        assert math.hypot(*(position - [row["x"], row["y"]])) < 5
    done = here("loops", "drive.yaml", "-o", "out", *known, "--session", "second", "--spacing", 8)
    assert done.returncode == 0, done.stderr
    done = here("case-study", "drive.yaml", "--pairs", 2, "-o", "study")
    assert done.returncode == 0, done.stderr
    assert "drive.yaml, first" in done.stdout


def test_scans_that_cannot_be_used_are_left_out_and_said(custom_drive, tmp_path, here):
    good = here(*BUILD, "drive.yaml", "-o", "good.map", "--spacing", 4, "--session", "first")
    assert good.returncode == 0, good.stderr
    assert "left out" not in good.stderr
    zeros, metres = tmp_path / "first" / "0.npy", tmp_path / "first" / "20.npy"
    np.save(zeros, np.zeros((50, 3)))
    np.save(metres, np.load(metres) * 1000)
    drive = ["drive.yaml", "--session", "first", "--spacing"]
    built = here(*BUILD, *drive, 0, "-o", "a.map")
    looped = here("loops", *drive, 16, "-o", "a")
    trust = ["--precision", 0.5, "-o", "c.map"]
    calibrated = here("map", "calibrate", "good.map", *drive, 24, *trust)
    for done, least in ((built, 2), (looped, 1), (calibrated, 1)):
        assert done.returncode == 0, done.stderr
        (said,) = [line for line in done.stderr.splitlines() if line.startswith("warning: ")]
        assert least <= int(said.split("session first: left out ")[1].split(" of ")[0]) <= 2
        assert "first/0.npy: " in said
    scans = len(list((tmp_path / "first").iterdir()))
    assert len(Map.open(tmp_path / "a.map")) == scans - 2
    assert 0 not in json.loads((tmp_path / "a.json").read_text())["scans"]
    # Where scans lie apart, the next one takes its place.
    assert here(*BUILD, *drive, 4, "-o", "b.map").returncode == 0
    names = [Map.open(tmp_path / f"{name}.map").places.names for name in ("good", "b")]
    assert names[0][0] == "0.npy" != names[1][0]
    assert abs(len(names[0]) - len(names[1])) <= 1


def test_too_many_scans_that_cannot_be_used_write_nothing(custom_drive, tmp_path, here):
    assert here(*BUILD, "drive.yaml", "-o", "m.map", "--session", "first").returncode == 0
    for path in sorted((tmp_path / "first").iterdir(), key=lambda path: int(path.stem))[::3]:
        np.save(path, np.zeros((50, 3)))
    before = {path.name for path in tmp_path.iterdir()}
    drive = ["drive.yaml", "--session", "first", "--spacing", 0, "-o"]
    for command in (BUILD, ("loops",), ("map", "calibrate", "m.map")):
        done = refused(here(*command, *drive, "new"), "scans cannot be used, expected at most 20%")
        assert done.returncode == 2
    assert {path.name for path in tmp_path.iterdir()} == before


def test_what_the_reader_skips_is_said(custom_drive, tmp_path, here):
    described = yaml.safe_load(custom_drive.read_text())
    first = described["drives"]["first"]
    records = tmp_path / "first_kitti"
    records.mkdir()
    for path in (tmp_path / "first").iterdir():
        points = np.load(path)
        np.pad(points, ((0, 0), (0, 1))).astype("<f4").tofile(records / f"{path.stem}.bin")
    (records / "7.bin").write_bytes(b"")
    first.update(scans="first_kitti", format="kitti")
    custom_drive.write_text(yaml.safe_dump(described))
    drive = ["drive.yaml", "--session", "first"]
    for done in (
        here(*BUILD, *drive, "-o", "a.map"),
        here("loops", *drive, "--spacing", 20, "-o", "a"),
        here("localize", "a.map", *drive, "--every", 40, "--as", "jsonl"),
    ):
        assert done.returncode == 0, done.stderr
        assert "warning: session first: left out 1 broken files" in done.stderr
        assert "7.bin: 0 bytes" in done.stderr
    assert all(json.loads(line)["scan"] for line in done.stdout.splitlines())


def test_rows_of_poses_that_are_left_out_are_no_warning(tiny_nclt, here):
    done = here("loops", tiny_nclt, "--session", "2031-03-17", "--spacing", 20, "-o", "a")
    assert "note: session 2031-03-17: left out 3 bad pose rows" in done.stderr


def test_mistakes_in_a_custom_drive_are_named(custom_drive, checkpoint, tmp_path, here):
    known = ["--checkpoint", checkpoint]
    refused(here(*BUILD, "drive.yaml", "-o", "a.map", *known), "first, second", "the name of one")
    refused(here(*BUILD, "none.yaml", "-o", "a.map", *known), "none.yaml", "cannot be read")
    custom_drive.write_text(custom_drive.read_text().replace("up: -z", "up: down"))
    refused(here("data", "check", "drive.yaml"), "drive.yaml", "up: 'down'", "-z")
    custom_drive.write_text("scans: [velodyne")
    refused(here("loops", "drive.yaml", "-o", "a", *known), "drive.yaml", "invalid YAML")
    assert not list(tmp_path.glob("a.*"))


def test_a_network_is_evaluated_on_a_custom_drive(custom_drive, checkpoint, here):
    options = ["data=custom", "data.root=drive.yaml", "evaluation.regions=[whole]"]
    options += ["data.split=sessions", "data.database=first", "data.query=second"]
    options += ["evaluation.figures=false", "data.spacing.query=20"]
    done = here("evaluate", f"checkpoint={checkpoint}", *options)
    assert done.returncode == 0, done.stderr
    assert "Recall@1" in done.stdout


def test_a_map_is_not_put_together_with_itself(place_map, tmp_path, here):
    done = here("map", "merge", place_map, place_map, "-o", "a.map")
    refused(done, "both hold the same places")
    assert not list(tmp_path.iterdir())


def test_options_that_the_scans_leave_without_a_meaning(place_map, second, tmp_path, here):
    for k in range(3):
        (tmp_path / f"{k}.bin").write_bytes(second.files[k].read_bytes())
    done = refused(here("localize", place_map, tmp_path), "0.bin", "--format")
    assert len(done.stderr.splitlines()) == 1
    scans = ("localize", place_map, tmp_path / "0.bin", "--format", "nclt")
    for option in ("--topic", "--session", "--every"):
        refused(here(*scans, option, "3"), f"{option}: 3, expected only with a")


def test_scans_of_a_dataset_are_located_beside_their_poses(place_map, second, tiny_nclt, here):
    chosen = ("--session", second.name, "--every", "9", "--as", "jsonl")
    done = here("localize", place_map, tiny_nclt, *chosen)
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [Path(row["scan"]) for row in rows] == list(second.files[::9])
    refused(here("localize", place_map, tiny_nclt), "2 sessions", "--session")
    other = refused(here("localize", place_map, tiny_nclt, "--format", "mulran"), "use format nclt")
    assert other.stderr.splitlines()[1].startswith("  <sequence>/")


def test_of_a_folder_every_nth_scan_is_located(place_map, second, here):
    folder = second.files[0].parent
    done = here("localize", place_map, folder, "--format", "nclt", "--every", "9", "--as", "jsonl")
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [Path(row["scan"]) for row in rows] == sorted(folder.iterdir())[::9]


def test_consecutive_scans_are_joined(place_map, second, tmp_path, here, monkeypatch):
    """As files of a folder and as a bag; the last scan has company, the first one none."""
    step = np.float32([0.5, 0, 0])
    clouds = [scattered(0, n=9000) - k * step for k in range(3)]
    # Half a circle, which turns by 14° from scan to scan.
    half = [
        cloud[cloud[:, :2] @ [np.cos(k / 4), np.sin(k / 4)] > 0] for k, cloud in enumerate(clouds)
    ]
    (tmp_path / "scans").mkdir()
    for k, cloud in enumerate(half):
        np.save(tmp_path / "scans" / f"{k}.npy", cloud)
    bag = write_bag(tmp_path, "mcap", {"/points": [message(cloud) for cloud in half]})
    whole = Map(load_network("shipped").method)
    whole.add([clouds[0]], np.eye(4)[None], ["a"])
    whole.save(tmp_path / "whole.map")

    def rows(*options):
        done = here("localize", "whole.map", *options, "--as", "jsonl")
        assert done.returncode == 0, done.stderr
        return [json.loads(line) for line in done.stdout.splitlines()], done.stderr

    alone, _ = rows("scans")
    joined, said = rows("scans", "--accumulate", 3)
    assert joined[0] == alone[0]
    assert joined[2]["fit"] > alone[2]["fit"]
    assert math.hypot(joined[2]["x"] - 1.0, joined[2]["y"]) < 0.5
    assert "warning" not in said
    of_bag, _ = rows(bag, "--accumulate", 3)
    assert [row["fit"] for row in of_bag] == [row["fit"] for row in joined]
    np.save(tmp_path / "scans" / "3.npy", scattered(7, n=9000))
    assert "1 scans do not overlap" in rows("scans", "--accumulate", 3)[1]
    monkeypatch.setitem(sys.modules, "kiss_icp.kiss_icp", None)
    refused(here("localize", "no.map", "scans", "--accumulate", 2), "deepring[odometry]")
    assert rows("scans")[0][:3] == alone
