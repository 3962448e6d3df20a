"""`deepring status` as a user types it."""

import time
from pathlib import Path

import pytest

from deepring.evaluation.case import Case
from deepring.evaluation.results import write_results
from deepring.experiment.status import Status, write_status
from deepring.experiment.sweep_notes import KILLED, Note, write_note
from deepring.experiment.sweep_plan import PlannedJob, SweepPlan, begin_plan, end_plan
from deepring.experiment.workers import Worker
from helpers.cli import deepring, refused
from helpers.results import result_of
from helpers.schemas import of_schema

LONG = "method-a_method_of_a_long_name+seed-0+train-several_worlds_of_a_long_name"


@pytest.fixture
def sweep(tmp_path) -> Path:
    """A running sweep: a job is done, one failed, one runs, one waits."""
    folder = tmp_path / "sweep"
    jobs = tuple(PlannedJob(name, {"seed": "0"}) for name in ("a", "b", LONG, "d"))
    (folder / ".outcomes").mkdir(parents=True)
    begin_plan(folder, SweepPlan(jobs, outcomes=".outcomes"))
    now = time.time()
    for number, error in enumerate((None, "no scans in /data\nat line 3", KILLED)):
        note = Note(folder / jobs[number].folder, error, 1, Worker.here(), now)
        write_note(folder / ".outcomes" / f"{number}.json", note)
    write_status(folder / "a", Status("finished", score=0.75, took=600.0))
    trained = result_of(Case("DeepRING", "nclt", "nclt", "test"), 10.0, rates=(0.5, 0.9, 0.8, 0.7))
    alone = result_of(Case("RING", "", "nclt", "test"), 10.0)
    write_results(folder / "a" / "results.csv", [alone, trained])
    running = Status(
        "running", took=300.0, stage="epoch 9/20", share=0.43, seen=now, worker=Worker.here()
    )
    write_status(folder / LONG, running)
    return folder


def test_a_running_sweep_is_told_at_a_glance(sweep, tmp_path):
    done = deepring("status", "sweep", cwd=tmp_path, columns=80)
    assert done.returncode == 1, "a job failed"
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert "1 of 4 jobs done, 1 running, 1 failed, 1 waiting" in done.stdout
    assert "left" in done.stdout
    assert "epoch 9/20, 43 %" in done.stdout
    assert "R@1: Recall@1 within 10 m on nclt test" in lines
    (row,) = (line for line in lines if line.startswith(" a "))
    assert row.split() == ["a", "done", "10:00", "min", "0.750", "0.500"]
    assert "failed       b: no scans in /data" in lines


def test_as_json_it_is_of_its_schema(sweep, tmp_path):
    done = deepring("status", "sweep", "--as", "json", cwd=tmp_path)
    (content,) = of_schema("status", done.stdout)["sweeps"]
    assert content["runs"] is True
    assert [job["state"] for job in content["jobs"]] == ["finished", "failed", "running", "waiting"]
    assert content["counts"]["waiting"] == 1
    assert content["jobs"][0]["headline"]["method"] == "DeepRING"
    assert content["seconds_left"] > 600
    assert content["jobs"][2]["share"] == 0.43


def test_after_the_end_it_says_what_is_left(sweep, tmp_path):
    end_plan(sweep, {"a": None, "b": "no scans", LONG: "interrupted"})
    write_status(sweep / LONG, Status("interrupted"))
    done = deepring("status", "sweep", cwd=tmp_path, columns=80)
    assert "1 of 4 jobs done, 0 running, 1 failed, 1 interrupted, 1 not begun" in done.stdout
    assert "ended " in done.stdout
    assert "the same command goes on with what is left" in done.stdout
    (content,) = of_schema(
        "status", deepring("status", sweep, "--as", "json", cwd=tmp_path).stdout
    )["sweeps"]
    assert (content["runs"], content["seconds_left"]) == (False, 0.0)


def test_all_done_exits_with_0_and_what_is_no_sweep_is_refused(tmp_path):
    write_status(tmp_path / "runs" / "a", Status("finished", took=5.0))
    done = deepring("status", "runs", cwd=tmp_path)
    assert done.returncode == 0
    assert "1 of 1 job done, 0 running, 0 failed" in done.stdout
    refused(deepring("status", "nowhere", cwd=tmp_path), "nowhere: no such folder")
