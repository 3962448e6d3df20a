"""The YAML file of custom drives: what it means, and each mistake as one clear error."""

from contextlib import suppress
from dataclasses import fields

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from deepring.data.readers.custom import open_custom
from deepring.data.readers.custom.drive_file import DriveDescription, is_drive_file, read_drives
from deepring.errors import DeepringError

LEAST = {"scans": "scans", "poses": "poses.txt", "sensor_height": 1.5}
SAME_FOLDER = settings(
    deadline=None,
    max_examples=150,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@pytest.fixture
def described(tmp_path):
    def write(content):
        path = tmp_path / "drive.yaml"
        text = content if isinstance(content, str) else yaml.safe_dump(content)
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_what_is_left_out_has_its_documented_value(described, tmp_path):
    (drive,) = read_drives(described(LEAST)).values()
    assert drive.name == "drive"
    assert (drive.scans, drive.poses) == (tmp_path / "scans", tmp_path / "poses.txt")
    assert (drive.pose_format, drive.up, drive.world_up) == ("kitti", "z", "z")
    assert drive.sensor_in_body is drive.z_band is drive.azimuth is drive.range is None
    empty = read_drives(described(LEAST | {"z_band": None, "up": None}))["drive"]
    assert (empty.z_band, empty.up) == (None, "z")


def test_drives_share_the_keys_above_and_may_have_their_own(described, tmp_path):
    shared = {"sensor_height": 1.5, "up": "-z", "poses": "/all.txt"}
    own = {"monday": {"scans": "a"}, "sunday": {"scans": "b", "up": "y"}}
    monday, sunday = read_drives(described(shared | {"drives": own})).values()
    assert (monday.name, sunday.name) == ("monday", "sunday")
    assert (monday.scans, sunday.scans) == (tmp_path / "a", tmp_path / "b")
    assert (monday.up, sunday.up) == ("-z", "y")
    assert str(monday.poses) == str(sunday.poses) == "/all.txt"


SHIFT = np.array([[0.0, -1, 0, 2], [1, 0, 0, 3], [0, 0, 1, 4], [0, 0, 0, 1]])


#: Twelve lists, of which each holds the one before ten times.
LAUGHS = ", ".join(
    ["&a0 [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]"]
    + [f"&a{k} [{', '.join(10 * [f'*a{k - 1}'])}]" for k in range(1, 12)]
)


@pytest.mark.parametrize(
    "value",
    [
        SHIFT[:3].ravel().tolist(),
        SHIFT.ravel().tolist(),
        SHIFT.tolist(),
        SHIFT[:3].tolist(),
        "0 -1 0 2  1 0 0 3  0 0 1 4",
        "calib.txt",
    ],
)
def test_a_sensors_pose_may_be_written_in_several_ways(value, described, tmp_path):
    (tmp_path / "calib.txt").write_text("P0: 1\nTr: 0 -1 0 2 1 0 0 3 0 0 1 4\n")
    drive = read_drives(described(LEAST | {"sensor_in_body": value}))["drive"]
    np.testing.assert_array_equal(drive.sensor_in_body, SHIFT)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scan": "x"}, ["scan: unknown key", "scans, format, poses", "sensor_height", "drives"]),
        ({3: "x"}, ["3: unknown key"]),
        ({"scans": 7}, ["scans: 7", "text"]),
        ({"poses": ""}, ["poses: ''"]),
        ({"scans": None}, ["scans: None"]),
        ({"name": 2012}, ["name: 2012", "quotes"]),
        ({"format": "las"}, ["format: 'las'", "kitti, mulran, nclt"]),
        ({"pose_format": "euroc"}, ["pose_format: 'euroc'", "kitti, tum"]),
        ({"up": "w"}, ["up: 'w'", "x, y, z, -x, -y, -z"]),
        ({"up": ["z"]}, ["up: ['z']"]),
        ({"up": "sensor"}, ["up: 'sensor'"]),
        ({"world_up": "down"}, ["world_up: 'down'", "-y", "sensor"]),
        ({"sensor_height": 0}, ["sensor_height: 0", "more than 0"]),
        ({"sensor_height": -1.7}, ["sensor_height: -1.7", "metres"]),
        ({"sensor_height": True}, ["sensor_height: True"]),
        ({"sensor_height": "high"}, ["sensor_height: 'high'"]),
        ({"sensor_height": float("nan")}, ["sensor_height: nan"]),
        ({"sensor_height": 10**400}, ["sensor_height: 1000"]),
        ({"z_band": [2, 2]}, ["z_band: [2, 2]", "LOW < HIGH", "above the ground"]),
        ({"z_band": [3, -1]}, ["z_band: [3, -1]"]),
        ({"z_band": [1]}, ["z_band: [1]"]),
        ({"z_band": 4}, ["z_band: 4"]),
        ({"z_band": [0, float("inf")]}, ["z_band: [0, inf]"]),
        ({"azimuth": [170, -170]}, ["azimuth: [170, -170]", "[90, 270]"]),
        ({"azimuth": [-200, 200]}, ["azimuth: [-200, 200]", "360"]),
        ({"range": [-1, 5]}, ["range: [-1, 5]", "at least 0"]),
        ({"sensor_in_body": [1, 2, 3]}, ["sensor_in_body: [1, 2, 3]", "12 numbers"]),
        ({"sensor_in_body": "2 0 0 0 0 1 0 0 0 0 1 0"}, ["sensor_in_body: '2 0", "rotation"]),
        ({"sensor_in_body": ["a"] * 12}, ["sensor_in_body", "12 numbers"]),
        ({"sensor_in_body": {"x": 1}}, ["sensor_in_body: {'x': 1}"]),
        ({"sensor_in_body": "none.txt"}, ["none.txt", "cannot be read"]),
        ({"drives": {}}, ["drives: {}", "at least one"]),
        ({"drives": ["a"]}, ["drives: ['a']", "mapping"]),
        ({"drives": {7: {}}}, ["drives, a name: 7", "quotes"]),
        ({"drives": {"a": 5}}, ["drives.a: 5", "mapping"]),
        ({"drives": {"a": {"upp": 5}}}, ["drives.a.upp: unknown key"]),
        ({"drives": {"a": {"up": 5}}}, ["drives.a.up: 5"]),
        ({"drives": {"a": {"drives": {}}}}, ["drives.a.drives: unknown key"]),
        ({"drives": {"a": None}, "name": "b"}, ["drives.a.name: unknown key"]),
    ],
)
def test_a_mistake_is_one_line_with_file_key_and_value(changes, words, described):
    path = described(LEAST | changes)
    with pytest.raises(DeepringError) as caught:
        read_drives(path)
    message = str(caught.value)
    assert "\n" not in message
    for word in [str(path.parent), *words]:
        assert word in message


@pytest.mark.parametrize("key", ["scans", "sensor_height"])
def test_a_missing_key_is_asked_for(key, described):
    path = described({name: value for name, value in LEAST.items() if name != key})
    with pytest.raises(DeepringError, match=rf"drive\.yaml: {key}: missing, expected .*: add it"):
        read_drives(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "None, expected a mapping"),
        ("- a\n- b", "expected a mapping"),
        ("just words", "'just words', expected a mapping"),
        ("scans: [a", "invalid YAML.*line 1"),
        ("scans: a\n\tposes: b", "invalid YAML.*line 2"),
        (f"range: [{LAUGHS}]", "aliases that stand for more than"),
        ("range: &a [1, *a]", "aliases that stand for more than"),
        ("scans: !!python/object:os.system x", "invalid YAML"),
        ("sensor_height: !!timestamp x", "invalid YAML"),
        ("a: " + "[" * 1200, "invalid YAML"),
    ],
)
def test_what_is_no_mapping_is_refused(text, words, described):
    with pytest.raises(DeepringError, match=rf"drive\.yaml: .*{words}"):
        read_drives(described(text))


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(DeepringError, match=r"none\.yaml: cannot be read"):
        read_drives(tmp_path / "none.yaml")
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00\xd8")
    with pytest.raises(DeepringError, match=r"bytes\.yaml: is not text"):
        read_drives(tmp_path / "bytes.yaml")


def test_a_folder_is_never_a_drive_file(tmp_path):
    (tmp_path / "a.yaml").mkdir()
    assert not is_drive_file(tmp_path / "a.yaml")
    assert is_drive_file("anywhere/b.yml")
    assert not is_drive_file("poses.txt")


def test_values_that_hold_themselves_are_shown_in_short(described):
    lists = "a: &a [x, x]\n" + "".join(
        f"{b}: &{b} [*{a}, *{a}, *{a}]\n" for a, b in zip("abcdefghij", "bcdefghijk", strict=True)
    )
    with pytest.raises(DeepringError) as caught:
        read_drives(described(f"name: [&x [*x]]\n{lists}"))
    assert len(str(caught.value)) < 2000


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.dates()
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=6,
)
keys = st.sampled_from(["name", "drives", "other", *(key.name for key in fields(DriveDescription))])


@SAME_FOLDER
@given(st.dictionaries(keys, values, max_size=6), st.booleans())
def test_any_values_are_a_drive_or_a_clear_error(described, content, complete):
    path = described((LEAST if complete else {}) | content)
    with suppress(DeepringError):
        for drive in read_drives(path).values():
            assert drive.sensor_height > 0


@SAME_FOLDER
@given(st.text(max_size=60) | st.text("{}[]:,-&*!|>'\"%@#? \nab0.~<", max_size=40))
def test_any_text_is_refused_by_a_clear_error(described, text):
    path = described("")
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    with pytest.raises(DeepringError):
        open_custom(path)
