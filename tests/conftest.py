"""Shared fixtures: real scans where they are at hand, one thread so that timings do not collide."""

import os
from pathlib import Path

import pytest
import torch

torch.set_num_threads(2)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real scans, or a skip that says what is missing."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("DEEPRING_TEST_DATA", default))
    if not folder.is_dir():
        pytest.skip("no real scans here: set DEEPRING_TEST_DATA to a folder that holds them")
    return folder
