"""`deepring train -m` as a user types it: names, failures, a kill, launchers, a search."""

import os
import signal
import subprocess
import time
from functools import partial
from pathlib import Path

import pytest

from deepring.evaluation.results import read_results
from deepring.experiment.config_groups import config_folder
from deepring.experiment.sweep_names import folder_name, naming
from helpers.cli import DEEPRING, SMALL, deepring, deepring_process, refused

QUICK = [*SMALL, "evaluation.figures=false"]
LONG = [a for a in QUICK if not a.startswith("trainer.max_epochs")]


@pytest.fixture
def start(tmp_path):
    """Starts a sweep in the background, in a process group of its own that ends with the test."""
    command = [DEEPRING, "train", "-m"]
    begun = []

    def started(arguments):
        process = subprocess.Popen(
            [*command, *arguments],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            # Where the suite itself runs in the background, SIGINT would be inherited as ignored.
            preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
        )
        begun.append(process)
        return process

    yield started
    for process in begun:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.stdout.close()
        process.wait()


def rates(sweep):
    """What the tables are made of: the rates of every job of a sweep folder."""
    return {
        folder.name: [
            (r.radius_m, r.recall_1, r.recall_5, r.f1_max, r.auc)
            for r in read_results(folder / "results.csv")
        ]
        for folder in sorted(sweep.iterdir())
        if (folder / "results.csv").is_file()
    }


def wait_for(path, process):
    deadline = time.monotonic() + 300
    while not path.is_file():
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_folders_are_named_after_what_is_varied():
    def excluded(*arguments):
        (override,) = naming(arguments, config_folder())
        return override.partition("=")[2]

    assert excluded("-m", "seed=0,1", "experiment=demo") == '["experiment"]'
    assert excluded("-m", "optimizer.lr=0.1,0.2", "data.root=/a=b") == "[]"  # Hydra refuses it
    assert (
        excluded("-m", "data.root=/a", "seed=0", "data.root=/a,/b") == "[]"
    )  # the last one counts
    assert excluded("-m", "sweep=table3", "variant=pg", "seed=0") == '["sweep"]'
    assert excluded("-m", "variant=pg", "sweep=way") == '["variant","sweep"]'
    assert excluded("-m", "seed=range(3)", "+trainer.detect_anomaly=true") == (
        '["+trainer.detect_anomaly","trainer.detect_anomaly"]'
    )


def test_a_folder_name_is_one_folder_and_never_empty():
    assert folder_name("seed-0+variant-pg") == "seed-0+variant-pg"
    assert folder_name("") == "run"
    assert folder_name("data.root-/a/b") == "data.root-_a_b"
    long = [folder_name("x" * 300 + end) for end in "ab"]
    assert len(set(long)) == 2
    assert max(map(len, long)) <= 200


def test_what_no_sweep_can_be_is_refused(tmp_path):
    both = deepring("train", "-m", "--cfg", "job", cwd=tmp_path)
    refused(both, "--cfg", "expected only one of the two")
    nowhere = deepring("train", "-m", "hydra.sweep.dir=", "seed=0,1", cwd=tmp_path)
    refused(nowhere, "hydra.sweep.dir=: no value, expected KEY=VALUE")
    refused(deepring("train", "-m", "sweep=tabel3", cwd=tmp_path), "tabel3")
    assert not list(tmp_path.rglob("seed-*"))


def test_one_failing_job_loses_no_other_and_the_next_start_skips_what_is_done(tiny_nclt, tmp_path):
    command = ["train", "-m", "experiment=demo", f"data.root={tiny_nclt}", *QUICK, "seed=-1,0"]
    done = refused(deepring(*command, cwd=tmp_path), "seed--1", "of at least 0")
    assert done.returncode == 1
    assert "1 of 2 jobs finished" in done.stdout
    sweep = tmp_path / "outputs" / "sweeps" / "demo_sweep"
    assert set(rates(sweep)) == {"seed-0"}
    assert "seed-0: job 2 of 2" in done.stderr
    assert "1 of 2 jobs done, 0 running, 1 failed" in done.stderr
    told = deepring("status", sweep, cwd=tmp_path)
    assert told.returncode == 1
    assert "failed       seed--1: seed: -1, expected" in told.stdout
    again = deepring(*command, cwd=tmp_path)
    assert "seed-0: finished before: skipped" in again.stderr
    assert "1 of 2 jobs finished" in again.stdout


@pytest.mark.slow  # `make kill` kills a sweep at many instants; test_sweep.py breaks a job off
def test_a_killed_sweep_started_again_ends_in_the_same_figures(tiny_nclt, tmp_path, start):
    command = [
        *("sweep=table3", "seed=0", "variant=ours,gap", "data=sim_nclt"),
        *(f"data.root={tiny_nclt}", "trainer.max_epochs=40", *LONG),
    ]
    sweeps = tmp_path / "outputs" / "sweeps"
    killed = start([*command, "sweep_name=killed"])
    job = sweeps / "demo_killed" / "seed-0+variant-ours"
    wait_for(job / "checkpoints" / "last.ckpt", killed)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.communicate()
    assert not (job / "results.csv").exists()  # in mid-run, indeed
    again = deepring("train", "-m", *command, "sweep_name=killed", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert "seed-0+variant-ours: going on from" in again.stderr
    assert "seed-0+variant-gap: going on" not in again.stderr
    whole = deepring("train", "-m", *command, "sweep_name=whole", cwd=tmp_path)
    assert whole.returncode == 0, whole.stderr
    assert not list((sweeps / "demo_whole").glob(".outcomes*"))
    assert len(rates(sweeps / "demo_whole")) == 2
    assert rates(sweeps / "demo_killed") == rates(sweeps / "demo_whole")


@pytest.mark.slow  # each process imports Lightning; a sweep's outcomes are tested in one process
@pytest.mark.parametrize("launcher", ["joblib", "submitit_local"])
def test_launchers_run_the_same_jobs(launcher, tiny_nclt, tmp_path):
    limits = {"joblib": "hydra.launcher.n_jobs=2", "submitit_local": "hydra.launcher.timeout_min=5"}
    done = deepring_process(
        *("train", "-m", "experiment=demo", f"data.root={tiny_nclt}", *QUICK, "seed=0,-1"),
        *(f"hydra/launcher={launcher}", limits[launcher]),
        cwd=tmp_path,
    )
    refused(done, "seed--1", "of at least 0")
    assert "1 of 2 jobs finished" in done.stdout
    assert set(rates(tmp_path / "outputs" / "sweeps" / "demo_sweep")) == {"seed-0"}


@pytest.mark.filterwarnings("ignore")  # of optuna 2 and sqlalchemy 1, which the sweeper needs
def test_the_search_maximises_validation_and_tests_nothing(tiny_nclt, tmp_path):
    done = deepring(
        *("train", "-m", "sweep=optuna", "experiment=demo", f"data.root={tiny_nclt}"),
        *(*QUICK, "hydra.sweeper.n_trials=2"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "2 of 2 jobs finished" in done.stdout
    sweep = tmp_path / "outputs" / "sweeps" / "demo_optuna"
    assert "best_value" in (sweep / "optimization_results.yaml").read_text()
    assert not list(sweep.glob("*/results.csv"))


def test_ctrl_c_ends_the_sweep_and_says_how_to_go_on(tiny_nclt, tmp_path, start):
    sweep = start(
        ["experiment=demo", f"data.root={tiny_nclt}", *LONG, "trainer.max_epochs=500", "seed=0,1"]
    )
    folder = tmp_path / "outputs" / "sweeps" / "demo_sweep"
    wait_for(folder / "seed-0" / "checkpoints" / "last.ckpt", sweep)
    os.killpg(sweep.pid, signal.SIGINT)
    output = sweep.communicate(timeout=120)[0]
    assert sweep.returncode == 130, output
    assert "the same command goes on" in output
    assert "0 of 1 jobs finished" in output
    assert "Traceback" not in output
    assert not (folder / "seed-1").exists()


def workers(pid):
    """Process numbers of a sweep's joblib workers."""
    threads = Path(f"/proc/{pid}/task").glob("*/children")
    children = [child for thread in threads for child in thread.read_text().split()]
    return [int(n) for n in children if b"popen_loky" in Path(f"/proc/{n}/cmdline").read_bytes()]


@pytest.mark.slow  # four processes; test_sweep_outcomes.py tests the same without them
def test_a_killed_worker_loses_no_job(tiny_nclt, tmp_path, start):
    sweep = start(
        [
            *("experiment=demo", f"data.root={tiny_nclt}", *LONG, "trainer.max_epochs=40"),
            *("seed=0,1", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2"),
        ]
    )
    folder = tmp_path / "outputs" / "sweeps" / "demo_sweep"
    wait_for(folder / "seed-0" / "checkpoints" / "last.ckpt", sweep)
    os.kill(workers(sweep.pid)[0], signal.SIGKILL)
    output = sweep.communicate(timeout=240)[0]
    assert sweep.returncode == 0, output
    assert "launching what is left again" in output
    assert "2 of 2 jobs finished" in output
    assert "Traceback" not in output
    assert set(rates(folder)) == {"seed-0", "seed-1"}


@pytest.mark.slow  # four processes; test_stop_signals.py and test_sweep_outcomes.py without them
def test_sigterm_ends_the_workers_too(tiny_nclt, tmp_path, start):
    sweep = start(
        [
            *("experiment=demo", f"data.root={tiny_nclt}", *LONG, "trainer.max_epochs=500"),
            *("seed=0,1", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2"),
        ]
    )
    folder = tmp_path / "outputs" / "sweeps" / "demo_sweep"
    wait_for(folder / "seed-0" / "checkpoints" / "last.ckpt", sweep)
    left = workers(sweep.pid)
    assert left
    os.kill(sweep.pid, signal.SIGTERM)
    output = sweep.communicate(timeout=120)[0]
    assert sweep.returncode == 143, output
    assert "the same command goes on" in output
    assert "killed" not in output
    assert "Traceback" not in output
    assert not any(Path(f"/proc/{worker}/exe").exists() for worker in left)


def test_a_sweep_over_several_devices_is_refused(tiny_nclt, tmp_path):
    done = deepring(
        *("train", "-m", "experiment=demo", f"data.root={tiny_nclt}", *QUICK, "seed=0,1"),
        "trainer.devices=2",
        cwd=tmp_path,
    )
    refused(done, "trainer.devices: 2", "without -m")
    assert "0 of 2 jobs finished" in done.stdout
