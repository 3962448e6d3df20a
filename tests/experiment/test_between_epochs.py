"""Hard negatives and growing batches: they do something, and a resumed run sees the same."""

import pytest
import torch

from deepring.experiment.status import read_status
from deepring.experiment.train import train
from deepring.training.batch_hard import ScanBatchSet
from deepring.training.tuples import TupleSet
from helpers.small_training import TINY_DATA, TINY_METHODS


@pytest.fixture
def run(composed, tiny_nclt, tmp_path):
    def trained(name, method, epochs, *overrides):
        cfg = composed(
            *(f"data.root={tiny_nclt}", f"method={method}", *TINY_METHODS[method], *TINY_DATA),
            *(f"trainer.max_epochs={epochs}", "trainer.log_every_n_steps=1"),
            *("callbacks.progress=null", "evaluate=false", f"paths.run={tmp_path / name}"),
            *overrides,
        )
        return train(cfg, tmp_path / name)

    return trained


def weights(trained):
    last = trained.folder / "checkpoints" / "last.ckpt"
    return torch.load(last, weights_only=True)["state_dict"]


def same(a, b):
    return all(torch.equal(a[key], b[key]) for key in a)


def test_hard_negatives_are_sought_from_their_epoch_on(run, monkeypatch):
    lengths = []
    before = TupleSet.before_epoch

    def before_epoch(tuples, epoch, method):
        tuples.vectors = None
        before(tuples, epoch, method)
        lengths.append(None if tuples.vectors is None else len(tuples.vectors))

    monkeypatch.setattr(TupleSet, "before_epoch", before_epoch)
    run("late", "disco", 3, "sampling.hard_from=1")
    assert lengths[0] is None
    assert lengths[1] == lengths[2] > 20  # all training scans
    lengths.clear()
    run("none", "disco", 2, "sampling.hard=0")
    assert lengths == [None, None]


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists")
@pytest.mark.parametrize("method", ["disco", "egonn"])
def test_a_resumed_run_draws_what_an_undisturbed_one_draws(run, method):
    grown = ["sampling.expand_below=1", "sampling.expand_by=1.5"] if method == "egonn" else []
    whole = weights(run("whole", method, 3, *grown))
    run("stopped", method, 2, *grown)
    last = "{}/stopped/checkpoints/last.ckpt"
    folder = run("again", method, 1, *grown).folder.parent
    resumed = run("stopped", method, 3, *grown, f"resume={last.format(folder)}")
    assert same(whole, weights(resumed))


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists")
def test_a_training_on_streets_resumes_to_the_digit(composed, tiny_nclt, tmp_path):
    def trained(name, epochs, *overrides):
        streets = ("stretches=1", "places=2", "queries=4", "spacing=[5,8]", "per_epoch=2")
        cfg = composed(
            *(f"data.root={tiny_nclt}", "method/encoder=unet_small", "sampling=streets"),
            *("loss=graded_cross_entropy", *(f"sampling.{value}" for value in streets), *TINY_DATA),
            *(f"trainer.max_epochs={epochs}", "trainer.log_every_n_steps=1"),
            *("callbacks.progress=null", "evaluate=false", f"paths.run={tmp_path / name}"),
            *overrides,
        )
        return weights(train(cfg, tmp_path / name))

    whole, before = trained("whole", 2), trained("stopped", 1)
    last = tmp_path / "stopped" / "checkpoints" / "last.ckpt"
    assert same(whole, trained("stopped", 2, f"resume={last}"))
    assert not same(whole, before)


def test_batches_grow_only_where_few_triplets_are_active(run, monkeypatch):
    sizes = []
    get = ScanBatchSet.__getitem__

    def seen(self, index):
        batch = get(self, index)
        sizes.append(self.size)
        return batch

    monkeypatch.setattr(ScanBatchSet, "__getitem__", seen)
    run(
        "grows", "egonn", 3, "sampling.expand_below=1", "sampling.expand_by=1.5", "loss.margin=1e-6"
    )
    assert sizes[-6:] == [4, 4, 6, 6, 6, 6]  # two batches an epoch, a limit of 6
    sizes.clear()
    run("stays", "egonn", 3, "sampling.expand_below=0", "sampling.expand_by=1.5")
    assert set(sizes) == {4}


def test_the_training_time_is_noted(run):
    assert 0 < read_status(run("timed", "disco", 1).folder).seconds < 600
