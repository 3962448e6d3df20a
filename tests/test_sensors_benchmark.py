"""The table of sensors: every pair of them, with intervals, and a run that goes on."""

import csv
import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from deepring.data.scan_set import ScanSet
from deepring.data.scans.npy import read_npy
from deepring.data.session import Session
from deepring.errors import ConfigError
from deepring.methods.ring import Ring

MODULES = ("sensors", "peer_table")
KNOBS = ("block=40", "rows=2", "test_columns=2", "crossing_jitter=0", "scan_spacing=12")


@pytest.fixture
def sensors(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    yield importlib.import_module("sensors")
    for name in MODULES:
        sys.modules.pop(name, None)


def test_each_pair_of_sensors_has_a_recall_with_its_interval(sensors, tmp_path, capsys):
    arguments = ["-o", str(tmp_path), "--only", "vlp16", "livox_avia", "--seed", "3", *KNOBS]
    sensors.main(arguments)
    text = capsys.readouterr().out
    for name in ("deepring", "ring"):
        lines = (tmp_path / f"{name}.csv").read_text(encoding="utf-8").splitlines()
        rows = list(csv.DictReader(lines))
        pairs = [(row["map"], row["query"]) for row in rows]
        names = ("vlp16", "livox_avia")
        assert pairs == [(one, other) for one in names for other in names]
        for row in rows:
            assert float(row["low"]) <= float(row["recall"]) <= float(row["high"])
            assert f"{float(row['recall']):.3f} ({float(row['low']):.2f}" in text
            assert int(row["answerable"]) > 5
        assert float(rows[0]["recall"]) > float(rows[1]["recall"])  # half the view is missing
    written = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.pcd")}
    sensors.main(arguments)
    assert capsys.readouterr().out == text
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.pcd")} == written


def test_a_query_without_a_descriptor_is_a_miss_and_one_without_a_place_no_query(sensors):
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = 0.0, 30.0, 60.0, 200.0
    session = Session("drive", tuple(map(Path, "abcd")), poses, poses[:, :2, 3], None, read_npy)
    places, queries = (sensors.Side.__new__(sensors.Side) for _ in range(2))
    places.scans, queries.scans = ScanSet(session, np.arange(3)), ScanSet(session, np.arange(4))
    descriptors = torch.randn(3, 120, 61, generator=torch.Generator().manual_seed(0))
    seen = ScanSet(session, np.array([0, 2, 3]))
    cells = {places: (places.scans, descriptors), queries: (seen, descriptors[[0, 1, 2]])}
    # Scan 0 finds itself, 1 has no descriptor, 2 looks like 1, and 3 is far from every place.
    share = sensors.recall(Ring(), places, queries, cells)
    assert (share.good, share.of) == (1, 3)


def test_the_sensor_is_no_knob(sensors, tmp_path):
    with pytest.raises(ConfigError, match="--only"):
        sensors.main(["-o", str(tmp_path), "sensor=vlp16"])
