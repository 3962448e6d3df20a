"""SIGKILL at random instants of every long command: started again, it ends in the same result.

`make kill` runs them (KILLS=20 instants of each, SEED=0). A command runs in a fork that has all
imports behind it, so that the kills hit its work.
"""

import os
import random
import re
import shutil
import time

import pytest

from helpers.small_training import EPISODES, TINY_DATA
from kill.forks import fork_server
from kill.outcomes import contents, expect_whole_runs, figures, parts

pytestmark = pytest.mark.kill

KILLS = int(os.environ.get("KILLS", "20"))
SEED = int(os.environ.get("SEED", "0"))

STREETS = ("train_columns=2", "test_columns=2", "rows=2", "block=45", "azimuths=240")
QUICK = (*EPISODES, *TINY_DATA, "evaluation.figures=false", "trainer.log_every_n_steps=1")


@pytest.fixture(scope="module")
def forks():
    with fork_server() as server:
        yield server


def survives(forks, tmp_path, command, outcome, *, before=None, after_kill=None, once=False):
    """Kill a command at `KILLS` instants; each time the same command must end as if never killed.

    ``outcome`` reads the result from a folder, ``before`` fills the folder in which it is started,
    and ``after_kill`` gets the folder of a killed run and the whole result. A command that writes
    ``once`` refuses to overwrite a result that was complete before the kill.
    """
    whole = fresh(tmp_path / "whole", before)
    seconds = forks.run(command, whole)
    seconds = min(seconds, forks.run(command, fresh(tmp_path / "second", before)))  # files cached
    expected = outcome(whole)
    assert expected
    instants = random.Random(f"{SEED} {command}")
    hits = 0
    for number in range(KILLS):
        folder = fresh(tmp_path / f"kill{number}", before)
        instant = instants.uniform(0.01, 0.97) * seconds
        hits += forks.run_and_kill(command, folder, instant)
        if after_kill is not None:
            after_kill(folder, expected)
        if not (once and outcome(folder) == expected):
            forks.run(command, folder)
        assert outcome(folder) == expected, f"killed after {instant:.3f} of {seconds:.3f} s"
        assert not parts(folder), f"killed after {instant:.3f} of {seconds:.3f} s"
        shutil.rmtree(folder)
    print(f"{command[0]}: {hits} of {KILLS} kills hit it within {seconds:.1f} s, 0 differing")
    assert hits >= KILLS // 2


def fresh(folder, before):
    folder.mkdir()
    if before is not None:
        before(folder)
    return folder


def no_other_content(name):
    """A check that each file below ``name`` is as in the end: none is written in part."""

    def check(folder, expected):
        written = contents(folder / name)
        assert {path: expected.get(path) for path in written} == written

    return check


def test_simulate(forks, tmp_path):
    command = ["simulate", "nclt", "-o", "world", *STREETS, "scan_spacing=5"]

    def check(folder, expected):
        written = contents(folder / "world")
        written.pop("simulation.json", None)  # says that it is incomplete, and is replaced
        assert {path: expected.get(path) for path in written} == written

    survives(forks, tmp_path, command, lambda folder: contents(folder / "world"), after_kill=check)


def test_train(forks, tiny_nclt, tmp_path):
    command = ["train", "experiment=demo", f"data.root={tiny_nclt}", *QUICK]
    survives(
        forks,
        tmp_path,
        [*command, "trainer.max_epochs=6"],
        lambda folder: figures((folder / "outputs" / "demo" / "latest").resolve()),
        after_kill=lambda folder, _: expect_whole_runs(folder),
    )


def test_train_goes_on_from_its_last_checkpoint(forks, tiny_nclt, tmp_path):
    command = ["train", "experiment=demo", f"data.root={tiny_nclt}", *QUICK]
    command += ["trainer.max_epochs=8", "hydra.run.dir=run"]
    seconds = forks.run(command, fresh(tmp_path / "whole", None))
    expected = figures(tmp_path / "whole" / "run")
    instants = random.Random(SEED)
    for number in range(KILLS):
        folder = fresh(tmp_path / f"kill{number}", None)
        forks.run_and_kill(command, folder, instants.uniform(0.3, 0.97) * seconds)
        last = folder / "run" / "checkpoints" / "last.ckpt"
        if last.is_file():
            forks.run([*command, f"resume={last}"], folder)
            assert figures(folder / "run") == expected
        shutil.rmtree(folder)


def test_sweep(forks, tiny_nclt, tmp_path):
    command = ["train", "-m", "experiment=demo", f"data.root={tiny_nclt}", *QUICK]
    command += ["trainer.max_epochs=4", "seed=0,1"]
    survives(
        forks,
        tmp_path,
        command,
        lambda folder: figures(folder / "outputs" / "sweeps"),
        after_kill=lambda folder, _: expect_whole_runs(folder),
    )


def test_compare(forks, tiny_nclt, tmp_path):
    command = ["compare", "--fixed=", "--learned", "deepring_small", "--train", "sim_nclt"]
    command += ["--test", "sim_nclt", "--seeds", "0,1", *EPISODES, "trainer.max_epochs=2"]
    command += [re.sub(r"^data\.", "train_data.sim_nclt.", part) for part in TINY_DATA]
    command += ["callbacks.progress=null", "trainer.log_every_n_steps=1"]

    def link(folder):
        (folder / "outputs" / "datasets").mkdir(parents=True)
        (folder / "outputs" / "datasets" / "sim_nclt").symlink_to(tiny_nclt)

    survives(
        forks,
        tmp_path,
        command,
        lambda folder: figures(folder / "outputs" / "sweeps"),
        before=link,
        after_kill=lambda folder, _: expect_whole_runs(folder),
    )


def test_map_build(forks, tiny_nclt, tmp_path):
    command = ["map", "build", tiny_nclt, "--session", "2031-02-04", "-o", "out/town.map"]
    survives(
        forks,
        tmp_path,
        [*command, "--spacing", "1"],
        lambda folder: contents(folder / "out"),
        after_kill=no_other_content("out"),
        once=True,
    )


def test_loops(forks, tiny_nclt, tmp_path):
    command = ["loops", tiny_nclt, "--session", "2031-02-04", "-o", "out/loops", "--spacing", "5"]
    survives(
        forks,
        tmp_path,
        command,
        lambda folder: contents(folder / "out"),
        after_kill=no_other_content("out"),
        once=True,
    )


def test_two_processes_that_fill_one_cache(forks, tiny_nclt, tmp_path):
    evaluation = ["evaluate", "data=sim_nclt", f"data.root={tiny_nclt}", *TINY_DATA]
    evaluation += ["evaluation.figures=false", "paths.cache=cache", "hydra.run.dir=run"]
    seconds = forks.run(evaluation, fresh(tmp_path / "whole", None))
    expected = figures(tmp_path / "whole" / "run")
    instants = random.Random(SEED)
    for number in range(KILLS):
        folder = fresh(tmp_path / f"kill{number}", None)
        first = forks.start(evaluation, folder)
        second = forks.start([*evaluation, "hydra.run.dir=second"], folder)
        pid = instants.choice([first, second])
        time.sleep(instants.uniform(0.01, 0.97) * seconds)
        forks.kill(pid)
        statuses = {one: forks.wait(one) for one in (first, second)}
        survivor = second if pid == first else first
        assert statuses[survivor] == 0, (folder / "log.txt").read_text()
        forks.run([*evaluation, "hydra.run.dir=third"], folder)
        assert figures(folder / "third") == expected
        shutil.rmtree(folder)


def test_report(forks, tiny_nclt, tmp_path):
    run = tmp_path / "evaluated"
    run.mkdir()
    forks.run(
        ["evaluate", "data=sim_nclt", f"data.root={tiny_nclt}", *TINY_DATA, "hydra.run.dir=run"],
        run,
    )
    command = ["report", "run", "-o", "out/page.html"]

    def copy(folder):
        shutil.copytree(run / "run", folder / "run", symlinks=True)

    survives(
        forks,
        tmp_path,
        command,
        lambda folder: contents(folder / "out"),
        before=copy,
        after_kill=no_other_content("out"),
        once=True,
    )
