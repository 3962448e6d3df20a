"""The class of every point, against what the geometry says; and the bytes of earlier versions."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest

from deepring.core.rigid import pose_from
from deepring.simulation.mounting import hdl32e_upside_down
from deepring.simulation.presets import nclt, tiny
from deepring.simulation.scene import Scene
from deepring.simulation.sensors import scan
from deepring.simulation.shapes import GROUNDS, PointClass, PrismList
from helpers.scenes import flat_ground

POSE = pose_from(np.eye(3), [0.0, 0.0, -0.15])

#: SHA-256 of five scans and poses of the tiny worlds, as they were before points had classes.
DIGESTS = {
    "nclt": "7c5511acfe9bc61d5fafd8500862079aece81e9a4510570c46b0de35305ce50f",
    "mulran": "5b8457b41b48c4300f8f894b07348bde3c4a0f2730520aa4b8f48244b28f076f",
}


def in_world(scene, session, index):
    """World points (n, 3) and labels (n,) of the returns of one scan."""
    sweep, drive = scene.sweep(session, index), scene.drives[session]
    pose = drive.poses(drive.scan_stamps[index : index + 1])[0] @ scene.sensors[session].mount
    return sweep.points[sweep.valid] @ pose[:3, :3].T + pose[:3, 3], sweep.labels[sweep.valid]


def digest(scene):
    """Hash of scans and poses, rounded so that no processor's last bit counts."""
    told = hashlib.sha256()
    for session in (0, 1):
        drive = scene.drives[session]
        told.update(np.round(drive.poses(drive.pose_stamps[::50]) * 1e5).astype("<i4").tobytes())
        told.update(drive.scan_stamps.astype("<i8").tobytes())
        for index in (0, 11, 31):
            sweep = scene.sweep(session, index)
            told.update(np.round(sweep.points[sweep.valid] * 1e4).astype("<i4").tobytes())
            told.update(sweep.valid.tobytes())
            told.update(np.round(sweep.reflectance * 1e4).astype("<i4").tobytes())
    return told.hexdigest()


@pytest.mark.parametrize("name", ["nclt", "mulran"])
def test_the_worlds_of_earlier_versions_keep_their_bytes(name):
    assert digest(Scene(tiny(name))) == DIGESTS[name]


def test_the_values_are_those_of_semantickitti():
    wanted = {0, 10, 40, 44, 48, 50, 51, 52, 70, 71, 72, 80, 99, 252, 254}
    assert {kind.value for kind in PointClass} == wanted


def test_every_return_has_the_class_of_what_it_hit_and_the_others_have_none():
    things = PrismList()
    things.box((20.0, 0.0), (1.0, 8.0), 0.0, (-0.5, 9.0), kind=PointClass.BUILDING)
    things.cylinder((-20.0, 0.0), 2.0, (-0.5, 9.0), kind=PointClass.POLE)
    settings = replace(nclt(), azimuths=360, range_noise=0.0, dropout_near=0.3)
    rng = np.random.default_rng(0)
    sweep = scan(hdl32e_upside_down(), POSE, 0.0, things.freeze(), flat_ground(), settings, rng)
    labels, points = sweep.labels, sweep.points + np.array([0.002, 0.004, 0.807])
    assert labels.dtype == np.uint16
    assert ((labels == PointClass.NOTHING) == ~sweep.valid).all()
    np.testing.assert_allclose(points[labels == PointClass.ROAD][:, 2], 0.0, atol=1e-9)
    np.testing.assert_allclose(points[labels == PointClass.BUILDING][:, 0], 19.5, atol=1e-9)
    pole = points[labels == PointClass.POLE]
    np.testing.assert_allclose(np.hypot(pole[:, 0] + 20.0, pole[:, 1]), 2.0, atol=1e-9)
    assert set(np.unique(labels)) == {0, PointClass.ROAD, PointClass.BUILDING, PointClass.POLE}


@pytest.mark.parametrize("name", ["nclt", "mulran"])
def test_classes_agree_with_the_geometry_of_a_world(name):
    scene = Scene(replace(tiny(name), movers=30.0, range_noise=0.0))
    scans = [in_world(scene, 0, index) for index in (5, 20, 40)]
    points, labels = (np.concatenate(parts) for parts in zip(*scans, strict=True))
    above = points[:, 2] - scene.world.ground.height(points[:, 0], points[:, 1])
    assert np.abs(above[np.isin(labels, GROUNDS)]).max() < 0.12  # between samples of its profile
    for kind, lowest, highest in (
        (PointClass.CROWN, 1.9, 10.5),
        (PointClass.PARKED_CAR, -0.2, 2.8),
        (PointClass.MOVING_CAR, -0.2, 3.4),
        (PointClass.MOVING_PERSON, -0.2, 2.0),
        (PointClass.TRUNK, -0.2, 4.7),
    ):
        of_kind = above[labels == kind]
        assert len(of_kind) > 10, kind
        assert lowest < of_kind.min()
        assert of_kind.max() < highest
    assert (labels == PointClass.BUILDING).mean() > 0.1
    assert (labels != PointClass.NOTHING).all()
