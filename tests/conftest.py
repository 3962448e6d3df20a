"""Shared fixtures. One thread a process: the suite runs in several."""

import gc
import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

from pathlib import Path

import pytest

from deepring.simulation.presets import tiny
from deepring.simulation.simulate import simulate


def pytest_collection() -> None:
    """Nothing that collection makes is garbage: modules, functions, tests."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Leave a million objects that stay to the end out of every later search for garbage."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 10, 10)
    gc.enable()


@pytest.fixture
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables are printed for a wide terminal, each row on one line."""
    monkeypatch.setenv("COLUMNS", "200")


@pytest.fixture(scope="session")
def tiny_nclt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few streets in NCLT's layout."""
    return simulate(tiny("nclt"), tmp_path_factory.mktemp("simulated") / "nclt")


@pytest.fixture(scope="session")
def tiny_custom(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few streets in the layout of any sensor."""
    return simulate(tiny("custom"), tmp_path_factory.mktemp("simulated") / "custom")


@pytest.fixture(scope="session")
def tiny_mulran(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few streets in MulRan's layout."""
    return simulate(tiny("mulran"), tmp_path_factory.mktemp("simulated") / "mulran")
