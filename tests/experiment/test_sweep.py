"""One job of a sweep: skipped, gone on with, or refused; never overwritten."""

import multiprocessing
import shutil

import pytest
import torch

from deepring.errors import DeepringError, StoppedError
from deepring.evaluation.results import read_results
from deepring.experiment.status import (
    Status,
    note_failure,
    read_status,
    sole_worker,
    write_status,
)
from deepring.experiment.sweep import run_job

TINY = (
    "experiment=demo",
    "sampling.ways=2",
    "sampling.queries=1",
    "sampling.per_epoch=2",
    "trainer.log_every_n_steps=1",
    "data.spacing.train=1",
    "data.regions.validation_share=0.3",
    "data.regions.margin=1",
    "methods={ring: null, scan_context: null, scan_context_120: null}",
    "evaluation.figures=false",
    "evaluation.rerank=[]",
    "callbacks.progress=null",
)


@pytest.fixture
def config(composed, tiny_nclt):
    """A function from a run's folder and overrides to its config."""
    return lambda folder, *overrides: composed(
        *TINY, f"data.root={tiny_nclt}", f"paths.run={folder}", *overrides
    )


def rates(folder):
    rows = read_results(folder / "results.csv")
    return [(r.radius_m, r.recall_1, r.recall_5, r.f1_max, r.auc) for r in rows]


def contents(folder):
    """Every file but the lock, with its time of change."""
    return {
        path: path.stat().st_mtime_ns
        for path in folder.rglob("*")
        if path.is_file() and path.name != ".lock"
    }


def test_a_finished_job_is_left_alone_and_tells_its_score_again(config, tmp_path):
    folder = tmp_path / "job"
    score = run_job(config(folder, "trainer.max_epochs=1"), folder)
    assert 0 <= score <= 1
    status = read_status(folder)
    assert (status.state, status.score) == ("finished", score)
    assert status.seconds > 0
    before = contents(folder)
    assert run_job(config(folder, "trainer.max_epochs=1"), folder) == score
    assert contents(folder) == before
    assert not (tmp_path / "latest").exists()  # TensorBoard would show that run twice


def test_a_job_broken_off_goes_on_and_ends_as_if_undisturbed(config, tmp_path):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    run_job(config(whole, "trainer.max_epochs=3"), whole)

    def kill(*_args):
        raise SystemError("broken off")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("deepring.training.episodes.EpisodeSet.__getitem__", _until(4, kill))
        with pytest.raises(SystemError):
            run_job(config(killed, "trainer.max_epochs=3"), killed)
    # Two epochs were whole: it goes on from the second, whichever was the better one.
    kept = torch.load(killed / "checkpoints" / "last.ckpt", weights_only=True)
    assert kept["global_step"] == 4
    run_job(config(killed, "trainer.max_epochs=3"), killed)
    assert rates(killed) == rates(whole)
    assert list(killed.glob("config_resumed_*.yaml"))


def _until(count, then):
    """The true method ``count`` times, and ``then`` from there on."""
    from deepring.training.episodes import EpisodeSet

    true, calls = EpisodeSet.__getitem__, []

    def method(self, index):
        calls.append(index)
        return true(self, index) if len(calls) <= count else then()

    return method


def test_every_epoch_can_be_gone_on_from_although_none_is_better(config, tmp_path, caplog):
    folder = tmp_path / "job"
    still = ("optimizer.lr=0", "method.encoder.norm=none", "trainer.max_epochs=3", "evaluate=false")
    with caplog.at_level("INFO", logger="deepring"):
        run_job(config(folder, *still), folder)
    # The validation recall never moves: the first epoch is the best, and the third the last.
    epochs = {
        name: torch.load(folder / "checkpoints" / f"{name}.ckpt", weights_only=True)["epoch"]
        for name in ("best", "last")
    }
    assert epochs == {"best": 0, "last": 2}
    lines = [line for line in caplog.messages if line.startswith("epoch ")]
    assert [line.partition(":")[0] for line in lines] == ["epoch 1/3", "epoch 2/3", "epoch 3/3"]
    assert all("train/loss" in line and "val/recall@1" in line for line in lines)


def test_a_job_killed_while_it_evaluated_trains_no_more(config, tmp_path):
    folder = tmp_path / "job"
    run_job(config(folder, "trainer.max_epochs=1"), folder)
    expected = rates(folder)
    (folder / "results.csv").unlink()
    write_status(folder, Status("running"))
    weights = (folder / "checkpoints" / "best.ckpt").stat().st_mtime_ns
    run_job(config(folder, "trainer.max_epochs=1"), folder)
    assert rates(folder) == expected
    assert (folder / "checkpoints" / "best.ckpt").stat().st_mtime_ns == weights


def test_a_run_that_was_moved_still_knows_its_best(config, tmp_path):
    folder, moved = tmp_path / "job", tmp_path / "moved"
    run_job(config(folder, "trainer.max_epochs=2"), folder)
    status, expected = read_status(folder), rates(folder)
    folder.rename(moved)
    write_status(moved, Status("running"))
    (moved / "results.csv").unlink()
    run_job(config(moved, "trainer.max_epochs=2"), moved)
    ended = read_status(moved)
    assert (ended.state, ended.score) == (status.state, status.score)
    assert rates(moved) == expected


def test_what_chooses_the_weights_is_a_part_of_the_config(config, tmp_path):
    folder = tmp_path / "job"
    run_job(config(folder, "trainer.max_epochs=1"), folder)
    with pytest.raises(DeepringError, match=r"callbacks\.checkpoint\.mode: max, now min"):
        run_job(config(folder, "trainer.max_epochs=1", "callbacks.checkpoint.mode=min"), folder)


def test_a_failure_before_the_start_is_kept_too(config, tmp_path):
    folder = tmp_path / "job"
    with pytest.raises(DeepringError, match="nowhere"):
        run_job(config(folder, "data.root=/nowhere"), folder)
    assert read_status(folder).state == "failed"


@pytest.mark.parametrize("text", ["", "- 1", "seed: [", "a: ${"])
def test_a_config_that_cannot_be_read_is_named(config, tmp_path, text):
    folder = tmp_path / "job"
    folder.mkdir()
    (folder / "config.yaml").write_text(text)
    with pytest.raises(DeepringError, match=r"(?s)config\.yaml.*delete that folder"):
        run_job(config(folder, "trainer.max_epochs=1"), folder)


def test_a_folder_of_another_config_is_refused_and_stays(config, tmp_path):
    folder = tmp_path / "job"
    run_job(config(folder, "trainer.max_epochs=1"), folder)
    before = contents(folder)
    with pytest.raises(DeepringError, match=r"sampling\.ways: 2, now 3.*sweep_name"):
        run_job(config(folder, "trainer.max_epochs=1", "sampling.ways=3"), folder)
    assert contents(folder) == before
    # Where a run lies and what it shows is no other config.
    shutil.copytree(folder, tmp_path / "moved")
    run_job(config(tmp_path / "moved", "trainer.max_epochs=1", "workers=1"), tmp_path / "moved")


def test_a_failure_is_kept_and_tried_again(config, tmp_path):
    folder = tmp_path / "job"
    wide = ("method.encoder.widths=[2,2,2,2,2,2]", "trainer.max_epochs=1")  # 32 does not divide 60
    with pytest.raises(DeepringError, match=r"encoder\.widths: 6 levels"):
        run_job(config(folder, *wide), folder)
    status = read_status(folder)
    assert status.state == "failed"
    assert "encoder.widths: 6 levels" in status.error
    with pytest.raises(DeepringError, match=r"encoder\.widths: 6 levels"):
        run_job(config(folder, *wide), folder)


def test_several_devices_are_for_single_runs(config, tmp_path):
    with pytest.raises(DeepringError, match=r"trainer\.devices: 2"):
        run_job(config(tmp_path / "job", "trainer.devices=2"), tmp_path / "job")
    assert not (tmp_path / "job").exists()


def _hold(folder, held, done):
    with sole_worker(folder):
        held.set()
        done.wait(30)


def test_two_processes_never_work_on_one_run(config, tmp_path):
    context = multiprocessing.get_context("spawn")
    held, done = context.Event(), context.Event()
    process = context.Process(target=_hold, args=(tmp_path / "job", held, done))
    process.start()
    assert held.wait(60)
    with pytest.raises(DeepringError, match="another process"):
        run_job(config(tmp_path / "job", "trainer.max_epochs=1"), tmp_path / "job")
    process.kill()  # the lock goes with the process
    process.join()
    with sole_worker(tmp_path / "job"):
        pass


def test_status_reads_back_and_junk_is_named(tmp_path):
    assert read_status(tmp_path) is None
    for status in (Status("running"), Status("failed", error="why"), Status("finished", score=0.5)):
        write_status(tmp_path, status)
        assert read_status(tmp_path) == status
    for junk in ('{"state": "fin', '{"state": "zzz"}', '{"state": "failed", "error": 5}', "[1]"):
        (tmp_path / "status.json").write_text(junk)
        with pytest.raises(DeepringError, match=r"status\.json"):
            read_status(tmp_path)


@pytest.mark.parametrize("stop", [KeyboardInterrupt, StoppedError])
def test_an_interruption_is_no_failure(stop, tmp_path):
    with pytest.raises(stop), note_failure(tmp_path):
        raise stop
    assert read_status(tmp_path) == Status("interrupted")


def test_a_failure_names_the_type_where_it_is_no_mistake(tmp_path):
    with pytest.raises(ZeroDivisionError), note_failure(tmp_path):
        _ = 1 / 0
    assert read_status(tmp_path).error == "ZeroDivisionError: division by zero"
