"""Sensors of data sheets, their mounting, and the layout that carries any of them."""

from dataclasses import replace

import numpy as np
import pytest

from deepring.data.readers import open_session
from deepring.errors import ConfigError
from deepring.simulation.mounting import sensor_of
from deepring.simulation.presets import custom, nclt, tiny, with_knobs
from deepring.simulation.scene import Scene
from deepring.simulation.sensor_models import SENSORS
from deepring.simulation.sensors import scan
from deepring.simulation.shapes import PrismList
from deepring.simulation.simulate import session_names, simulate
from helpers.cli import deepring
from helpers.scenes import flat_ground

CLEAN = replace(
    custom(), range_noise=0.0, dropout_near=0.0, dropout_far=0.0, tilt_deg=0.0, azimuths=90
)
SPINNING = [name for name, model in SENSORS.items() if model.rosette is None]
PAIR = replace(
    tiny("custom"),
    scan_spacing=40.0,
    sensor="vlp16",
    query_sensor="os0_128",
    query_sensor_height=0.8,
    query_upside_down=True,
)


def shoot(things, **knobs):
    """A sweep from the origin of level ground."""
    settings = replace(CLEAN, **knobs)
    sensor = sensor_of(settings, 0)
    rng = np.random.default_rng(0)
    sweep = scan(sensor, np.eye(4), 0.0, things.freeze(), flat_ground(), settings, rng)
    return sensor, sweep


def walls(distance: float, top: float) -> PrismList:
    things = PrismList()
    for yaw in np.arange(4) * np.pi / 2:
        centre = (distance * np.cos(yaw), distance * np.sin(yaw))
        things.box(centre, (1.0, 3 * distance), yaw, (-0.5, top))
    return things


@pytest.mark.parametrize("name", SPINNING)
@pytest.mark.parametrize("upside_down", [False, True])
def test_beams_are_where_the_data_sheet_has_them(name, upside_down):
    _, sweep = shoot(walls(10.0, 40.0), sensor=name, upside_down=upside_down)
    assert sweep.valid.mean() > 0.9
    reach = np.hypot(sweep.points[..., 0], sweep.points[..., 1])
    elevation = np.rad2deg(np.arctan2(sweep.points[..., 2], reach))
    seen = np.nanmedian(elevation, axis=0)
    beams = np.array(SENSORS[name].beams)
    np.testing.assert_allclose(seen, -beams[::-1] if upside_down else beams, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "lowest", "highest", "count"),
    [
        ("vlp16", -15.0, 15.0, 16),
        ("vlp32c", -25.0, 15.0, 32),
        ("hdl32e", -30.67, 10.67, 32),
        ("hdl64e", -24.33, 2.0, 64),
        ("os0_128", -45.0, 45.0, 128),
        ("os1_64", -16.6, 16.6, 64),
        ("os2_128", -11.25, 11.25, 128),
    ],
)
def test_fields_of_view(name, lowest, highest, count):
    beams = SENSORS[name].beams
    assert (beams[0], beams[-1], len(beams)) == (lowest, highest, count)
    assert list(beams) == sorted(set(beams))


def test_a_sensor_sees_as_far_as_its_sheet_and_the_knob_say():
    for far, seen in ((49.0, True), (52.0, False)):
        _, sweep = shoot(walls(far, 40.0), sensor="os0_128")
        high = sweep.points[..., 2] > -1.0
        assert high.any() == seen
    _, sweep = shoot(walls(40.0, 40.0), sensor="os2_128", max_range=30.0)
    assert np.nanmax(np.linalg.norm(sweep.points, axis=-1)) <= 30.0


def test_noise_is_the_sheets_unless_given():
    clean = shoot(walls(20.0, 40.0), sensor="os2_128", azimuths=720)[1].points
    for noise, wanted in ((None, SENSORS["os2_128"].noise), (0.2, 0.2)):
        noisy = shoot(walls(20.0, 40.0), sensor="os2_128", azimuths=720, range_noise=noise)[1]
        error = np.linalg.norm(noisy.points, axis=-1) - np.linalg.norm(clean, axis=-1)
        assert np.nanstd(error) == pytest.approx(wanted, rel=0.05)


def test_columns_are_the_sheets_unless_given():
    assert len(shoot(PrismList(), sensor="hdl64e", azimuths=None)[1].points) == 2083
    assert len(shoot(PrismList(), sensor="hdl64e", azimuths=77)[1].points) == 77


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    return simulate(PAIR, tmp_path_factory.mktemp("pair") / "sim")


@pytest.mark.parametrize("session", [0, 1])
def test_a_drive_reads_back_in_the_world_with_its_own_sensor(pair, session):
    scene = Scene(PAIR)
    drive, sensor = scene.drives[session], scene.sensors[session]
    read = open_session("custom", pair / "drive.yaml", session_names(PAIR)[session])
    assert len(read) == len(drive.scan_stamps)
    np.testing.assert_array_equal(read.stamps, drive.scan_stamps * 1000)
    assert read.ground_z == -(1.8, 0.8)[session]
    for k in (0, len(read) - 1):
        pose = drive.poses(drive.scan_stamps[k : k + 1])[0] @ sensor.mount
        np.testing.assert_allclose(read.poses[k], pose, atol=2e-6)
        sweep = scene.sweep(session, k)
        np.testing.assert_allclose(read.read(read.files[k]), sweep.points[sweep.valid], atol=1e-5)


def test_an_upside_down_sensor_is_stored_in_its_own_axes(pair):
    """Read as if it were upright, the ground would be above, and left and right exchanged."""
    file = sorted((pair / "query" / "scans").iterdir())[0]
    raw = open_session("custom", pair / "drive.yaml", "query").read(file)
    text = (pair / "drive.yaml").read_text()
    (pair / "wrong.yaml").write_text(text.replace("up: -z", "up: z"))
    with pytest.raises(ConfigError, match=r"tilted by 1[78]\d°"):
        open_session("custom", pair / "wrong.yaml", "query")
    body = file.read_bytes().split(b"DATA binary\n")[1]
    stored = np.frombuffer(body, "<f4").reshape(-1, 4)[:, :3]
    np.testing.assert_array_equal(stored * [1, -1, -1], raw)
    assert np.median(stored[:, 2]) > 0.5  # the ground


def test_what_is_lost_of_the_layout_is_written_again(tmp_path):
    root = simulate(replace(PAIR, scan_spacing=50.0), tmp_path / "sim")
    files = [root / "drive.yaml", root / "map" / "poses.tum"]
    files += sorted((root / "query" / "scans").iterdir())[:2]
    before = [file.read_bytes() for file in files]
    for file in files:
        file.unlink()
    simulate(replace(PAIR, scan_spacing=50.0), root)
    assert [file.read_bytes() for file in files] == before


@pytest.mark.parametrize(
    ("base", "knobs", "complaint"),
    [
        (custom, {"sensor": "vlp64"}, "sensor: 'vlp64', expected one of vlp16, vlp32c"),
        (custom, {"sensor": None}, "sensor: None, expected one of vlp16"),
        (custom, {"query_sensor": "x"}, "query_sensor: 'x', expected one of vlp16"),
        (custom, {"sensor_height": None}, "sensor_height: None, expected a number from 0.2"),
        (custom, {"query_sensor_height": 0.0}, "query_sensor_height: 0.0, expected a number"),
        (custom, {"upside_down": 1}, "upside_down: 1, expected True or False"),
        (custom, {"upside_down": None}, "upside_down: None, expected True or False"),
        (nclt, {"sensor": "vlp16"}, "sensor: 'vlp16', expected None in the layout nclt.*custom"),
        (nclt, {"query_upside_down": True}, "query_upside_down: True, expected None"),
        (nclt, {"azimuths": None}, "azimuths: None, expected a whole number"),
    ],
)
def test_knobs_that_cannot_be_are_named(base, knobs, complaint):
    with pytest.raises(ConfigError, match=complaint):
        with_knobs(base(), knobs)


@pytest.mark.parametrize(
    ("knob", "complaint"),
    [
        ("upside_down=yes", "upside_down: 'yes', expected true or false"),
        ("sensor=vlp", "sensor: 'vlp', expected one of vlp16"),
        ("rows=2.5", "rows: '2.5', expected a whole number"),
        ("query_sensor_height=low", "query_sensor_height: 'low', expected a number"),
    ],
)
def test_knobs_of_the_command_line(knob, complaint, tmp_path):
    result = deepring("simulate", "custom", "-o", tmp_path / "sim", knob, cwd=tmp_path)
    assert result.returncode != 0
    assert complaint in result.stderr
    assert not (tmp_path / "sim").exists()


@pytest.mark.parametrize(
    ("name", "session", "index", "count", "metres", "stamp"),
    [
        ("nclt", 0, 5, 3558, 74098.2939115472, 1927983620614185),
        ("nclt", 1, 7, 3975, 65723.40445116986, 1931536825372546),
        ("mulran", 0, 5, 5058, 95432.75705780467, 1927983605152922),
        ("mulran", 1, 7, 4010, 85980.44208899263, 1931536805113126),
    ],
)
def test_what_the_first_layouts_give_does_not_change(name, session, index, count, metres, stamp):
    scene = Scene(tiny(name))
    assert scene.drives[session].scan_stamps[index] == stamp
    sweep = scene.sweep(session, index)
    assert sweep.valid.sum() == count
    assert np.nansum(np.abs(sweep.points)) == pytest.approx(metres, rel=1e-9)
