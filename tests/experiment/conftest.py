"""Composed configs, and a KITTI sequence with revisits."""

from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from deepring.cli.experiments import config_folder
from deepring.data.nclt import open_nclt
from deepring.experiment.config import check_config


@pytest.fixture
def composed(tmp_path):
    """A function from overrides to a checked config, writing below tmp_path."""

    def make(*overrides, name="train"):
        with initialize_config_dir(str(config_folder()), version_base="1.3"):
            cfg = compose(
                name,
                [f"paths.outputs={tmp_path}", f"paths.run={tmp_path / 'run'}", *overrides],
            )
        return check_config(cfg)

    return make


@pytest.fixture(scope="session")
def tiny_kitti(tiny_nclt, tmp_path_factory) -> Path:
    """Both drives over the tiny streets as one KITTI sequence: the second revisits the first."""
    root = tmp_path_factory.mktemp("kitti")
    (root / "velodyne").mkdir()
    (root / "calib.txt").write_text("Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")
    rows, number = [], 0
    for date in ("2031-02-04", "2031-03-17"):
        session = open_nclt(tiny_nclt, date)
        for points, pose in zip(session, session.poses, strict=True):
            values = np.column_stack([points - [0, 0, 1.73], np.ones(len(points))])
            values.astype("<f4").tofile(root / "velodyne" / f"{number:06d}.bin")
            rows.append(pose[:3].ravel())
            number += 1
    np.savetxt(root / "poses.txt", rows)
    return root
