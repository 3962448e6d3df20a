"""Composed configs, and a KITTI sequence with revisits."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from deepring.data.readers.nclt import open_nclt
from deepring.experiment.compose import check_training
from deepring.experiment.config import check_config
from deepring.experiment.config_groups import config_folder, register_configs
from helpers.composing import read_files_once

read_files_once()


@pytest.fixture(scope="session")
def compose_in():
    """A function from an output folder and overrides to a checked config."""
    register_configs()

    def make(outputs, *overrides, name="train"):
        folders = [f"paths.outputs={outputs}", f"paths.run={outputs / 'run'}"]
        with initialize_config_dir(str(config_folder()), version_base="1.3"):
            given = [*folders, *overrides]
            if name == "train":
                return check_training(compose(name, given), given)
            return check_config(compose(name, given))

    return make


@pytest.fixture
def composed(compose_in, tmp_path):
    """The same, writing below tmp_path."""
    return partial(compose_in, tmp_path)


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
