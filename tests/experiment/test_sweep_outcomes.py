"""The outcomes of a sweep's jobs: who finished, who failed, and who is begun again after a kill."""

import errno
import json
import os
import platform
import subprocess
import sys
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import SimpleNamespace

import pytest

from deepring.errors import DataError, StoppedError
from deepring.experiment import sweep_outcomes
from deepring.experiment.sweep_outcomes import (
    ATTEMPTS,
    KILLED,
    OUTCOMES,
    OutcomesFolder,
    note_outcome,
    run_sweep,
)
from deepring.experiment.sweep_state import state_of
from helpers.sweeps import hydra_config


class Job:
    """A job of a sweep, of which Hydra tells its number and folder."""

    def __init__(self, sweep, number, monkeypatch):
        self.sweep, self.number, self.monkeypatch = sweep, number, monkeypatch
        self.folder = sweep / f"seed-{number}"
        self.attempts = 0

    def run(self, work):
        hydra = SimpleNamespace(
            runtime=SimpleNamespace(output_dir=str(self.folder)),
            job=SimpleNamespace(num=self.number),
        )
        self.monkeypatch.setattr(sweep_outcomes.HydraConfig, "get", lambda: hydra)
        with note_outcome(lambda error: isinstance(error, DataError)):
            self.attempts += 1
            work()

    def die(self):
        """Ends as a killed process does: with what was noted at its beginning."""
        self.run(lambda: None)
        note = Path(os.environ[OUTCOMES]) / f"{self.number:04d}.json"
        note.write_text(json.dumps(json.loads(note.read_text()) | {"error": KILLED}))


@pytest.fixture
def jobs(tmp_path, monkeypatch):
    return [Job(tmp_path, number, monkeypatch) for number in range(3)]


def swept(tmp_path, launch):
    """`run_sweep` of jobs that are launched as Hydra does it: after its callback."""
    config = hydra_config(tmp_path, "seed=0,1,2")

    def launched():
        OutcomesFolder().on_multirun_start(config)
        launch()

    outcomes = run_sweep(launched)
    assert OUTCOMES not in os.environ
    assert not list(tmp_path.glob(".outcomes*"))
    return outcomes


def test_a_job_that_ended_with_the_sweep_was_not_killed(jobs, tmp_path):
    def launch():
        jobs[0].run(lambda: None)
        jobs[1].die()  # as when the sweep ends its processes
        raise KeyboardInterrupt

    outcomes = swept(tmp_path, launch)
    assert outcomes.interrupted
    assert outcomes.finished == [jobs[0].folder]
    assert outcomes.failed == [(jobs[1].folder, "interrupted")]
    assert state_of(tmp_path).jobs[1].state == "interrupted"


def test_a_process_that_an_earlier_sweep_began_notes_for_this_one(jobs, tmp_path, monkeypatch):
    def launch():
        own = os.environ[OUTCOMES]
        with monkeypatch.context() as elsewhere:  # as in a process of joblib that is used again
            elsewhere.setenv(OUTCOMES, str(tmp_path / ".outcomes-before"))
            jobs[0].run(lambda: fail(DataError("no scans")))
        assert Path(own).is_dir()

    assert swept(tmp_path, launch).failed == [(jobs[0].folder, "no scans")]


def fail(error):
    raise error


def test_one_failing_job_loses_no_other(jobs, tmp_path, caplog):
    def launch():
        jobs[0].run(lambda: fail(DataError("no scans")))
        jobs[1].run(lambda: None)
        jobs[2].run(lambda: fail(RuntimeError("a bug")))

    outcomes = swept(tmp_path, launch)
    assert outcomes.finished == [jobs[1].folder]
    assert outcomes.failed == [
        (jobs[0].folder, "no scans"),
        (jobs[2].folder, "RuntimeError: a bug"),
    ]
    assert not outcomes.interrupted
    traces = [record.exc_info is not None and bool(record.exc_info) for record in caplog.records]
    assert traces == [False, True], "a bug keeps its traceback, a mistake has none"


def test_after_a_kill_the_jobs_are_launched_again(jobs, tmp_path):
    launches = []

    def launch():
        launches.append(1)
        if len(launches) == 1:
            jobs[0].die()
            raise BrokenProcessPool
        for job in jobs:
            job.run(lambda: None)

    outcomes = swept(tmp_path, launch)
    assert outcomes.finished == [job.folder for job in jobs]
    assert jobs[0].attempts == 2


def test_a_job_that_is_killed_each_time_is_given_up(jobs, tmp_path):
    def launch():
        jobs[1].run(lambda: None)
        jobs[0].die()
        raise BrokenProcessPool

    outcomes = swept(tmp_path, launch)
    assert jobs[0].attempts == ATTEMPTS
    assert outcomes.finished == [jobs[1].folder]
    assert outcomes.failed == [(jobs[0].folder, KILLED)]


def test_a_job_is_not_begun_more_often_though_others_still_may(jobs, tmp_path):
    def launch():
        jobs[0].run(lambda: None) if jobs[0].attempts >= ATTEMPTS else jobs[0].die()
        if jobs[1].attempts < ATTEMPTS:
            jobs[1].die()
            raise BrokenProcessPool

    outcomes = swept(tmp_path, launch)
    assert jobs[0].attempts == jobs[1].attempts == ATTEMPTS
    assert all(error.startswith(KILLED) for _, error in outcomes.failed)


def test_ctrl_c_ends_the_sweep(jobs, tmp_path):
    def launch():
        jobs[0].run(lambda: None)
        jobs[1].run(lambda: fail(StoppedError("stopped")))
        jobs[2].run(lambda: None)

    outcomes = swept(tmp_path, launch)
    assert outcomes.interrupted
    assert outcomes.finished == [jobs[0].folder]
    assert outcomes.failed == [(jobs[1].folder, "interrupted")]
    assert jobs[2].attempts == 0


def test_what_a_killed_sweep_left_is_removed_and_a_running_ones_stays(tmp_path, monkeypatch):
    monkeypatch.delenv(OUTCOMES, raising=False)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    here = f".outcomes-{platform.node()}-"
    left, running = tmp_path / f"{here}{ended.pid}-a", tmp_path / f"{here}{os.getppid()}-b"
    elsewhere = tmp_path / f".outcomes-another-machine-{ended.pid}-c"
    for folder in (left, running, elsewhere):
        folder.mkdir()
    config = hydra_config(tmp_path, "seed=0,1,2")
    OutcomesFolder().on_multirun_start(config)
    own = Path(os.environ.pop(OUTCOMES))
    assert set(tmp_path.iterdir()) == {running, elsewhere, own, tmp_path / "sweep.json"}


def test_a_full_disk_is_told_in_words(jobs, tmp_path):
    def launch():
        jobs[0].run(lambda: fail(OSError(errno.ENOSPC, "No space left on device", "a.ckpt")))

    (failed,) = swept(tmp_path, launch).failed
    assert failed == (jobs[0].folder, "a.ckpt: no space is left on the disk")
