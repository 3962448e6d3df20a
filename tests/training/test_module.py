"""The LightningModule: it learns, resumes to the digit, loads safely, runs in bf16."""

import zipfile
from functools import partial

import lightning as L
import numpy as np
import pytest
import torch

from deepring.data.packed_rasters import Rasters, pack
from deepring.errors import ConfigError, DeepringError, FileError
from deepring.methods.deepring import DeepRing
from deepring.methods.network_file import load_network
from deepring.rasters import BevRaster, raster_settings
from deepring.training.batch_order import BatchOrder
from deepring.training.callbacks import BetweenEpochs
from deepring.training.datamodule import RetrievalBatch
from deepring.training.episodes import EpisodeScheme, OneShotCrossEntropy
from deepring.training.module import PlaceModule
from deepring.training.training_scans import TrainingScans
from deepring.training.tuples import LazyQuadruplet, TupleScheme
from helpers.networks import deepring_settings

RASTER = BevRaster(cells=32)
SETTINGS = deepring_settings(
    raster=raster_settings(RASTER), angles=32, bins=32, widths=[4, 8], convolutions=1
)
EPISODE = EpisodeScheme(ways=4, shots=1, queries=2, per_epoch=6)


class Toy(L.LightningDataModule):
    """Places along a line; every scan of a place shows the same few cells, moved a little."""

    def __init__(self, places: int = 12, scans: int = 4, seed: int = 3) -> None:
        super().__init__()
        rng = np.random.default_rng(0)
        images, positions = [], []
        for place in range(places):
            cells = rng.integers(9, 23, (12, 2))
            for scan in range(scans):
                image = np.zeros((32, 32), dtype=bool)
                image[tuple((cells + rng.integers(-2, 3, 2)).T)] = True
                images.append(pack(image, RASTER))
                positions.append([40.0 * place + scan, 0.0])
        self.positions = np.array(positions)
        self.rasters = Rasters(np.stack(images), RASTER)
        dataset, headings = np.zeros(len(images), dtype=np.int64), np.zeros(len(images))
        scans = TrainingScans(self.positions, dataset, headings, self.rasters, dataset)
        self.episodes = EPISODE.training_set(scans, seed)

    def train_dataloader(self):
        order = BatchOrder(EPISODE.per_epoch, self.trainer.global_rank, self.trainer.world_size)
        return torch.utils.data.DataLoader(self.episodes, batch_size=None, sampler=order)

    def val_dataloader(self):
        database, query = slice(0, None, 4), slice(1, None, 4)
        apart = np.abs(self.positions[query, :1] - self.positions[database, 0])
        distances = torch.from_numpy(apart).float()
        batch = RetrievalBatch(self.rasters[database], self.rasters[query], distances)
        return [torch.utils.data.DataLoader([batch], batch_size=None)]


def module(seed=0, optimizer=None):
    L.seed_everything(seed, verbose=False)
    return PlaceModule(
        DeepRing(SETTINGS),
        EPISODE,
        OneShotCrossEntropy(),
        validation=["toy"],
        optimizer=optimizer or partial(torch.optim.Adam, lr=1e-2, weight_decay=1e-4),
        scheduler=partial(torch.optim.lr_scheduler.MultiStepLR, milestones=[2], gamma=0.1),
        trained_on="toy",
    )


def trainer(folder, epochs, **options):
    checkpoint = L.pytorch.callbacks.ModelCheckpoint(
        folder, "best", monitor="val/recall@1", mode="max", save_last=True
    )
    defaults = {"callbacks": [checkpoint], "logger": False, "devices": 1, "accelerator": "cpu"}
    return L.Trainer(
        max_epochs=epochs,
        default_root_dir=folder,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        use_distributed_sampler=False,
        **{**defaults, **options},
    )


def fit(model, folder, epochs, resume=None, data=None, **options):
    runner = trainer(folder, epochs, **options)
    runner.fit(model, data or Toy(), ckpt_path=resume, weights_only=True)
    return runner


def test_training_learns_the_toy_places(tmp_path):
    model = module()
    before = float(trainer(tmp_path, 1).validate(model, Toy(), verbose=False)[0]["val/recall@1"])
    after = float(fit(model, tmp_path, 5).callback_metrics["val/recall@1"])
    print(f"recall@1 untrained {before:.2f}, trained {after:.2f}")
    assert after > max(before, 0.9) - 1e-6


def test_the_same_seed_gives_the_same_weights_and_another_does_not(tmp_path):
    def trained(name, seed=0, episodes=3):
        model = module(seed)
        fit(model, tmp_path / name, 1, data=Toy(seed=episodes))
        return model.state_dict()

    def same(a, b):
        return [torch.equal(a[key], b[key]) for key in a]

    first = trained("first")
    assert all(same(first, trained("again")))
    # Another start alone, and other episodes from the same start.
    assert not all(same(first, trained("start", seed=1)))
    assert not all(same(first, trained("episodes", episodes=4)))


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists")
def test_resuming_ends_where_an_undisturbed_run_ends(tmp_path):
    undisturbed = module()
    fit(undisturbed, tmp_path / "a", 3)
    fit(module(), tmp_path / "b", 1)
    resumed = module()
    fit(resumed, tmp_path / "b", 3, resume=tmp_path / "b" / "last.ckpt")
    a, b = undisturbed.state_dict(), resumed.state_dict()
    assert all(torch.equal(a[key], b[key]) for key in a)


def test_a_checkpoint_carries_all_that_makes_its_descriptors(tmp_path):
    model = module()
    fit(model, tmp_path, 1)
    # weights_only: nothing but plain values and tensors in it.
    state = torch.load(tmp_path / "last.ckpt", weights_only=True)
    assert state["hyper_parameters"]["settings"]["raster"]["preprocessing"]["clearance"] == 0.5
    loaded = load_network(tmp_path / "last.ckpt")
    assert loaded.trained_on == "toy"
    assert loaded.method.raster == RASTER
    image = Toy().rasters[:3]
    assert torch.equal(loaded.method.describe(image), model.method.describe(image))


def test_a_loss_of_another_scheme_is_refused():
    with pytest.raises(ConfigError, match=r"loss: LazyQuadruplet, expected .* EpisodeLoss"):
        PlaceModule(DeepRing(SETTINGS), EPISODE, LazyQuadruplet())
    with pytest.raises(ConfigError, match=r"loss: OneShotCrossEntropy, expected .* TupleLoss"):
        PlaceModule(DeepRing(SETTINGS), TupleScheme(), OneShotCrossEntropy())


def test_a_missing_or_foreign_checkpoint_is_one_clear_error(tmp_path):
    with pytest.raises(DeepringError, match="is no file"):
        load_network(tmp_path / "none.ckpt")
    (tmp_path / "junk.ckpt").write_bytes(b"not a checkpoint")
    with pytest.raises(DeepringError, match="is no whole checkpoint"):
        load_network(tmp_path / "junk.ckpt")
    torch.save({"state_dict": {}}, tmp_path / "other.ckpt")
    with pytest.raises(DeepringError, match=r"other\.ckpt: .*lacks trained_on, loss"):
        load_network(tmp_path / "other.ckpt")


def test_an_altered_checkpoint_is_refused_wherever_the_byte_is(tmp_path):
    fit(module(), tmp_path, 1)
    path = tmp_path / "last.ckpt"
    content = path.read_bytes()
    with zipfile.ZipFile(path) as parts:
        tensors = [part for part in parts.infolist() if "/data/" in part.filename]
        weight = max(tensors, key=lambda part: part.file_size)
        stored = parts.read(weight)
    at = content.index(stored) + len(stored) // 2
    path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
    assert torch.load(path, weights_only=True)  # torch takes it
    with pytest.raises(FileError, match="cut short or altered; copy it again"):
        load_network(path)


def test_a_checkpoint_from_before_methods_had_names_is_told(tmp_path):
    fit(module(), tmp_path, 1)
    state = torch.load(tmp_path / "last.ckpt", weights_only=True)
    state["hyper_parameters"]["method"] = "deepring.methods.deepring.DeepRing"
    torch.save(state, tmp_path / "old.ckpt")
    with pytest.raises(FileError, match=r"old\.ckpt: .*an earlier version .*train or export it"):
        load_network(tmp_path / "old.ckpt")


def test_bf16_trains_and_describes_in_float32(tmp_path):
    model = module()
    runner = fit(model, tmp_path, 1, precision="bf16-mixed")
    assert torch.isfinite(runner.callback_metrics["train/loss"])
    assert model.method.describe(Toy().rasters[:2]).dtype == torch.float32


DESCENT = partial(torch.optim.SGD, lr=1e-2)  # linear in the gradient, which Adam rescales


def trained_by_hand(orders):
    """One process; each step takes the mean gradient of the episodes that the orders name."""
    model, episodes = module(optimizer=DESCENT), Toy().episodes
    model.log = lambda *_, **__: None  # there is no trainer to log to
    optimizer = DESCENT(model.parameters())
    for step in zip(*orders, strict=True):
        optimizer.zero_grad()
        for number in step:
            (model.training_step(episodes[number], 0) / len(step)).backward()
        optimizer.step()
    return model.state_dict()


def furthest(a, b):
    """The largest difference of any parameter."""
    names = [name for name, _ in module().named_parameters()]
    return max((a[name] - b[name]).abs().max().item() for name in names)


class Rank(EpisodeScheme):
    """Episodes whose step tells which process takes it."""

    def step(self, method, loss, batch):
        step = super().step(method, loss, batch)
        return step._replace(parts={"rank": torch.tensor(float(torch.distributed.get_rank()))})


class Told(Toy):
    """Writes down what the training set is told after an epoch, a file per process."""

    def __init__(self, folder):
        super().__init__()
        self.folder, self.train_set = folder, self

    def before_epoch(self, epoch, method):
        assert (epoch, type(method)) == (0, DeepRing)

    def after_epoch(self, parts):
        (self.folder / f"rank{self.trainer.global_rank}").write_text(str(parts))


def test_two_processes_train_on_different_episodes_and_agree(tmp_path):
    model = module(optimizer=DESCENT)
    model.scheme = Rank(ways=4, shots=1, queries=2, per_epoch=6)
    callbacks = [L.pytorch.callbacks.ModelCheckpoint(tmp_path, "last"), BetweenEpochs()]
    options = {"devices": 2, "strategy": "ddp_spawn", "callbacks": callbacks}
    fit(model, tmp_path, 1, data=Told(tmp_path), **options)
    # What sets learn between epochs is the mean of both processes, in both.
    assert [(tmp_path / f"rank{k}").read_text() for k in range(2)] == ["{'rank': 0.5}"] * 2
    found = torch.load(tmp_path / "last.ckpt", weights_only=True)["state_dict"]
    first, second = (BatchOrder(EPISODE.per_epoch, rank, 2) for rank in range(2))
    start = module().state_dict()
    apart = {
        name: furthest(found, state)
        for name, state in {
            "each its own": trained_by_hand([first, second]),
            "both the first's": trained_by_hand([first, first]),
            "both the second's": trained_by_hand([second, second]),
            "start": start,
        }.items()
    }
    print(f"largest difference of a parameter: {apart}")
    assert apart.pop("each its own") < 1e-5
    assert min(apart.values()) > 1e-3
