"""Shared fixtures. One thread a process: the suite runs in several."""

import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

from pathlib import Path

import pytest

from deepring.simulation.settings import tiny
from deepring.simulation.simulate import simulate


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real scans, or a skip that says what is missing."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("DEEPRING_TEST_DATA", default))
    if not folder.is_dir():
        pytest.skip("no real scans here: set DEEPRING_TEST_DATA to a folder that holds them")
    return folder


@pytest.fixture(scope="session")
def tiny_nclt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few streets in NCLT's layout."""
    return simulate(tiny("nclt"), tmp_path_factory.mktemp("simulated") / "nclt")


@pytest.fixture(scope="session")
def tiny_mulran(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few streets in MulRan's layout."""
    return simulate(tiny("mulran"), tmp_path_factory.mktemp("simulated") / "mulran")
