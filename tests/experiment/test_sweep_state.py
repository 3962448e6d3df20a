"""What a sweep's folder tells from outside: which jobs are done, run, wait, or are gone."""

import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from deepring.errors import FileError
from deepring.experiment.planned_jobs import planned
from deepring.experiment.signs_of_life import SignsOfLife, signs_of_life
from deepring.experiment.status import Status, note_failure, read_status, write_status
from deepring.experiment.sweep_lines import job_begins, job_ended
from deepring.experiment.sweep_notes import INTERRUPTED, KILLED, Note, write_note
from deepring.experiment.sweep_plan import PlannedJob, SweepPlan, begin_plan, end_plan, read_plan
from deepring.experiment.sweep_state import SILENT, state_of, states_in
from deepring.experiment.workers import Worker
from deepring.progress import progress_bar
from helpers.sweeps import hydra_config


@pytest.fixture(scope="module")
def gone():
    """A process of this machine that has ended."""
    ended = subprocess.Popen([sys.executable, "-S", "-c", ""])
    ended.wait()
    return replace(Worker.here(), process=ended.pid)


ELSEWHERE = Worker("another machine", 17, 4)
NAMES = ("seed-0", "seed-1", "seed-2")


class Sweep:
    """A sweep that this process has begun, whose jobs note what the test wants."""

    def __init__(self, folder):
        self.folder = folder
        (folder / ".outcomes").mkdir(parents=True)
        jobs = tuple(PlannedJob(name, {"seed": name[-1]}) for name in NAMES)
        begin_plan(folder, SweepPlan(jobs, outcomes=".outcomes"))

    def note(self, number, error, **fields):
        note = Note(self.folder / NAMES[number], error, 1, Worker.here(), time.time())
        write_note(self.folder / ".outcomes" / f"{number:04d}.json", replace(note, **fields))

    def status(self, number, *values, **fields):
        write_status(self.folder / NAMES[number], Status(*values, **fields))

    def change(self, **fields):
        """Change the plan, as another process would have written it."""
        path = self.folder / "sweep.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | fields))

    def states(self, now=None):
        return [job.state for job in state_of(self.folder, now).jobs]


@pytest.fixture
def sweep(tmp_path):
    return Sweep(tmp_path / "sweep")


def by_worker(worker):
    return {"worker": vars(worker)}


def test_the_jobs_are_known_before_they_begin(tmp_path):
    config = hydra_config(tmp_path, "variant=ours,gap", "seed=range(2)", "data.root=/a", "+w=1,2")
    plan = planned(config)
    assert len(plan.jobs) == 8
    assert plan.jobs[0].folder == "+w=1+seed=0+variant=ours".replace("=", "-")
    assert plan.jobs[0].varied == {"variant": "ours", "seed": "0", "+w": "1"}
    assert plan.jobs[0].kind == plan.jobs[2].kind != plan.jobs[4].kind
    assert plan.at_once == 1
    of_file = hydra_config(tmp_path, "sweep=way", params={"sampling.ways": "8,16", "seed": "0,1"})
    assert [job.folder for job in planned(of_file).jobs][:2] == [
        "sampling.ways-8+seed-0",
        "sampling.ways-8+seed-1",
    ]


def test_a_search_knows_only_how_many_jobs_it_has(tmp_path):
    plan = planned(hydra_config(tmp_path, "seed=0", trials=20, launcher={"n_jobs": 3}))
    assert (plan.jobs, plan.unnamed, plan.at_once) == ((), 20, 3)
    assert planned(hydra_config(tmp_path, "seed=0", launcher={"n_jobs": -1})).at_once == (
        os.cpu_count()
    )
    assert planned(hydra_config(tmp_path, "seed=0", launcher={"nodes": 4})).at_once is None
    sweep = tmp_path / "search"
    begin_plan(sweep, plan)
    write_status(sweep / "lr-0.1", Status("finished"))
    state = state_of(sweep)
    assert (state.total, state.count("waiting"), state.count("finished")) == (20, 19, 1)


def test_what_runs_is_done_or_waits_is_told_apart(sweep):
    sweep.status(0, "finished", took=60.0, score=0.5)
    sweep.note(0, None)
    sweep.note(1, KILLED)
    assert sweep.states() == ["finished", "running", "waiting"]
    sweep.status(1, "running", stage="epoch 1/4", share=0.25, seen=time.time(), took=15.0)
    state = state_of(sweep.folder)
    assert state.runs
    assert state.jobs[1].status.stage == "epoch 1/4"
    assert state.left.unknown == 0
    assert state.left.seconds == pytest.approx(45 + 60, abs=2)
    sweep.note(1, "no scans")
    assert sweep.states() == ["finished", "failed", "waiting"]
    assert state_of(sweep.folder).jobs[1].error == "no scans"
    sweep.note(1, INTERRUPTED)
    assert sweep.states() == ["finished", "interrupted", "waiting"]


def test_the_latest_of_several_runs_counts_once(tmp_path):
    write_status(tmp_path / "monday", Status("finished"))
    (tmp_path / "latest").symlink_to("monday")
    assert [job.folder.name for job in state_of(tmp_path).jobs] == ["monday"]


def test_a_dead_process_is_not_told_as_running(sweep, gone):
    sweep.note(0, KILLED, worker=gone)
    assert sweep.states() == ["killed", "waiting", "waiting"]
    sweep.change(**by_worker(gone))
    state = state_of(sweep.folder)
    assert not state.runs
    assert [job.state for job in state.jobs] == ["killed", "not begun", "not begun"]
    assert state.left == (0, 0)


def test_a_process_that_has_the_number_of_a_dead_one_is_another(sweep, monkeypatch):
    monkeypatch.setattr("deepring.experiment.workers._began", lambda process: 2)  # noqa: ARG005
    sweep.note(0, KILLED, worker=replace(Worker.here(), began=1))
    assert sweep.states()[0] == "killed"


def test_of_another_machine_the_signs_of_life_count(sweep):
    now = time.time()
    sweep.change(**by_worker(ELSEWHERE))
    sweep.note(0, KILLED, worker=ELSEWHERE, began=now - 10)
    state = state_of(sweep.folder, now)
    assert state.runs is None
    assert [job.state for job in state.jobs] == ["running", "waiting", "waiting"]
    assert sweep.states(now + SILENT) == ["silent", "waiting", "waiting"]
    sweep.status(0, "running", seen=now + SILENT, worker=ELSEWHERE)
    assert sweep.states(now + SILENT + 5)[0] == "running"
    assert state_of(sweep.folder, now + 2 * SILENT + 60).jobs[0].silence == SILENT + 60


def test_what_an_earlier_start_left_waits_until_it_is_its_turn(sweep, gone):
    sweep.status(0, "failed", error="no scans")
    sweep.status(1, "running", worker=gone)
    assert sweep.states() == ["waiting"] * 3
    end_plan(sweep.folder, {})
    assert sweep.states() == ["failed", "killed", "not begun"]


def test_after_the_end_failures_that_left_no_trace_in_their_folder_are_kept(sweep):
    sweep.status(0, "finished", took=5.0)
    sweep.status(1, "finished", took=5.0)
    end_plan(sweep.folder, {"seed-0": None, "seed-1": "holds a run of another config"})
    state = state_of(sweep.folder)
    assert [job.state for job in state.jobs] == ["finished", "failed", "not begun"]
    assert (state.count("finished"), state.count("failed"), state.total) == (1, 1, 3)
    assert state.plan.ended is not None
    assert state.plan.outcomes is None


def test_two_parts_of_one_command_are_one_sweep_and_a_new_command_is_a_new_one(sweep):
    begin_plan(sweep.folder, SweepPlan((PlannedJob("method-b", {"method": "b"}),)))
    plan = read_plan(sweep.folder)
    assert [(job.folder, job.part) for job in plan.jobs] == [
        *((name, 0) for name in NAMES),
        ("method-b", 1),
    ]
    begin_plan(sweep.folder, SweepPlan((PlannedJob("method-b"),)))
    assert len(read_plan(sweep.folder).jobs) == 4, "which begins after it was planned"
    sweep.change(**by_worker(ELSEWHERE))
    begin_plan(sweep.folder, SweepPlan((PlannedJob("method-c"),)))
    assert [job.folder for job in read_plan(sweep.folder).jobs] == ["method-c"]
    sweep.status(0, "finished")  # it stays, and is shown beside what is planned
    assert sweep.states() == ["waiting", "finished"]


def test_the_log_says_after_each_job_how_far_the_sweep_is(sweep):
    folder = sweep.folder / "seed-1"
    assert job_begins(folder) == "job 2 of 3"
    sweep.note(0, "no scans")
    sweep.status(1, "finished", took=130.0)
    sweep.note(1, None)
    assert job_ended(folder) == (
        "done in 2:10 min; 1 of 3 jobs done, 0 running, 1 failed, about 2:10 min left"
    )
    assert job_ended(sweep.folder / "seed-0").startswith("1 of 3 jobs done, 0 running, 1 failed")


def test_a_run_gives_signs_of_life_and_keeps_its_time_when_it_goes_on(tmp_path):
    with signs_of_life(tmp_path, before=100.0) as signs:
        first = read_status(tmp_path)
        assert (first.state, first.took, first.worker) == ("running", 100.0, Worker.here())
        with progress_bar("describing") as bar:
            bar(3, 10)
        assert read_status(tmp_path).stage == "describing: 3 of 10"
        assert signs.took >= 100.0
    with pytest.raises(ZeroDivisionError), note_failure(tmp_path):
        _ = 1 / 0
    assert read_status(tmp_path).took >= 100.0


def test_signs_are_few_and_within_a_training_its_epochs_count(tmp_path):
    now = [1000.0]
    signs = SignsOfLife(tmp_path, clock=lambda: now[0])

    def stage():
        return read_status(tmp_path).stage

    signs.work("reading", 1, 9)
    now[0] += 19
    signs.work("reading", 2, 9)
    assert stage() == "reading: 1 of 9"
    now[0] += 1
    signs.work("reading", 3, 9)
    assert stage() == "reading: 3 of 9"
    now[0] += 2
    signs.trains = True
    signs.work("validating", 3, 9)
    signs.training(2, 4, 0.375)
    status = read_status(tmp_path)
    assert (status.stage, status.share, status.took, status.seen) == ("epoch 2/4", 0.375, 22, 1022)


def test_a_folder_of_sweeps_shows_each_and_a_run_itself(sweep, tmp_path):
    sweep.status(0, "finished")
    write_status(tmp_path / "train" / "2031-01-01", Status("finished", took=3.0))
    found = {state.folder.name: state for state in states_in(tmp_path)}
    assert set(found) == {"sweep", "train"}
    assert found["train"].plan is None
    (alone,) = states_in(tmp_path / "train" / "2031-01-01")
    assert [job.state for job in alone.jobs] == ["finished"]
    (tmp_path / "empty").mkdir()
    for name, words in {"empty": "neither a sweep nor a run", "nowhere": "no such folder"}.items():
        with pytest.raises(FileError, match=words):
            list(states_in(tmp_path / name))


@pytest.mark.parametrize(
    "text",
    [
        *("", "[]", "{}", '{"jobs": 1}', '{"jobs": [{"folder": "../a"}]}', '{"jobs": [], "x": 1}'),
        *('{"jobs": [], "worker": 5}', '{"jobs": [], "outcomes": "a/b"}', '{"jobs": [{"f": 1}]}'),
    ],
)
def test_a_plan_that_is_none_is_named(tmp_path, text):
    (tmp_path / "sweep.json").write_text(text)
    with pytest.raises(FileError, match=r"sweep\.json"):
        read_plan(tmp_path)


def test_a_note_that_is_half_there_is_left_out(sweep):
    for number, text in enumerate(("{", "[1]", '{"folder": 1, "error": 2, "attempts": 3}')):
        (Path(sweep.folder) / ".outcomes" / f"000{number}.json").write_text(text)
    assert sweep.states() == ["waiting"] * 3
