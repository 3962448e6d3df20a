"""The benchmark of load, at small sizes: every task runs, and its limits are held."""

import importlib
import sys
from pathlib import Path

import pytest


@pytest.fixture
def benchmark(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    yield importlib.import_module
    for name in ("load", "load_tasks", "scenes"):
        sys.modules.pop(name, None)


def test_every_task_gives_figures_that_have_limits(benchmark, tmp_path, monkeypatch):
    load, tasks = benchmark("load"), benchmark("load_tasks")
    monkeypatch.setattr(tasks, "DRAWN", 5)
    monkeypatch.setattr(tasks, "STEP", 64)
    size = tasks.Size(places=130, scans=40, points=5000)
    assert tuple(tasks.TASKS) == load.TASKS
    figures = [vars(found) for task in load.TASKS for found in tasks.TASKS[task](tmp_path, size)]
    assert {found["what"] for found in figures} == set(load.LIMITS)
    assert [found["n"] for found in figures[:3]] == [64, 128, 130]
    assert all(found["seconds"] > 0 and found["megabytes"] > 10 for found in figures)


def figure(what, seconds, megabytes=100.0, n=10_000):
    return {"what": what, "n": n, "seconds": seconds, "megabytes": megabytes}


def test_what_is_beyond_its_limit_is_named(benchmark, monkeypatch, capsys):
    load = benchmark("load")
    limit = load.LIMITS["save a map"]
    within = [figure("save a map", limit.seconds, limit.megabytes)]
    assert load.problems(within) == []
    slow = figure("save a map", limit.seconds + 1)
    large = figure("open a map", 0, 1e6)
    assert load.problems([slow, large]) == [
        f"save a map: {limit.seconds + 1:.1f} seconds, limit {limit.seconds:g}",
        f"open a map: 1000000.0 megabytes, limit {load.LIMITS['open a map'].megabytes:g}",
    ]
    monkeypatch.setattr(load, "measured", lambda *_: [slow])
    with pytest.raises(SystemExit, match="save a map: "):
        load.main(["--tasks", "grow", "--check"])
    assert f"| save a map | 10000 | {slow['seconds']:.3g} | 100 |" in capsys.readouterr().out
    load.main(["--tasks", "grow"])  # without --check, figures alone


def test_growing_that_slows_down_is_named_whatever_it_takes(benchmark):
    load = benchmark("load")
    steady = [figure("10 000 places more", 1.0 + 0.1 * (k % 3)) for k in range(20)]
    assert load.problems(steady) == []
    quadratic = [figure("10 000 places more", 0.1 * (k + 1)) for k in range(20)]
    assert load.problems(quadratic) == [
        "10 000 places more: 0.10 s at the beginning, half of them beyond 3 times that; limit: as "
        "long at the end as at the beginning"
    ]
    lines = load.rows(steady)
    assert len(lines) == 4  # two of head, the first and the last
