"""The LightningModule: it learns, resumes to the digit, loads safely, runs in bf16."""

from functools import partial

import lightning as L
import numpy as np
import pytest
import torch

from deepring.core.rasters import BevRaster, raster_settings
from deepring.data.cache import Rasters, pack
from deepring.data.datamodule import RetrievalBatch
from deepring.data.episodes import EpisodeDataset, EpisodeOrder, EpisodeSettings, Places
from deepring.errors import DeepringError
from deepring.methods.deepring import DeepRingSettings
from deepring.training.module import DeepRingModule, load_deepring

RASTER = BevRaster(cells=32)
SETTINGS = DeepRingSettings(
    raster=raster_settings(RASTER), angles=32, bins=32, widths=[4, 8], convolutions=1
)
EPISODE = EpisodeSettings(ways=4, shots=1, queries=2, per_epoch=6)


class Toy(L.LightningDataModule):
    """Places along a line; every scan of a place shows the same few cells, moved a little."""

    def __init__(self, places: int = 12, scans: int = 4) -> None:
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
        pool = Places(self.positions, np.zeros(len(images), dtype=np.int64), EPISODE)
        self.episodes = EpisodeDataset(pool, self.rasters, seed=3)

    def train_dataloader(self):
        order = EpisodeOrder(EPISODE.per_epoch, self.trainer.global_rank, self.trainer.world_size)
        return torch.utils.data.DataLoader(self.episodes, batch_size=None, sampler=order)

    def val_dataloader(self):
        database, query = slice(0, None, 4), slice(1, None, 4)
        apart = np.abs(self.positions[query, :1] - self.positions[database, 0])
        distances = torch.from_numpy(apart).float()
        batch = RetrievalBatch(self.rasters[database], self.rasters[query], distances)
        return [torch.utils.data.DataLoader([batch], batch_size=None)]


def module():
    L.seed_everything(0, verbose=False)
    return DeepRingModule(
        SETTINGS.to_dict(),
        validation=["toy"],
        optimizer=partial(torch.optim.Adam, lr=1e-2, weight_decay=1e-4),
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


def fit(model, folder, epochs, resume=None, **options):
    runner = trainer(folder, epochs, **options)
    runner.fit(model, Toy(), ckpt_path=resume, weights_only=True)
    return runner


def test_training_learns_the_toy_places(tmp_path):
    model = module()
    before = float(trainer(tmp_path, 1).validate(model, Toy(), verbose=False)[0]["val/recall@1"])
    after = float(fit(model, tmp_path, 5).callback_metrics["val/recall@1"])
    print(f"recall@1 untrained {before:.2f}, trained {after:.2f}")
    assert after > max(before, 0.9) - 1e-6


def test_the_same_seed_gives_the_same_weights_and_another_does_not(tmp_path):
    runs = []
    for k in range(2):
        model = module()
        fit(model, tmp_path / str(k), 1)
        runs.append(model.state_dict())
    assert all(torch.equal(runs[0][key], runs[1][key]) for key in runs[0])


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
    loaded = load_deepring(tmp_path / "last.ckpt")
    assert loaded.trained_on == "toy"
    assert loaded.method.raster == RASTER
    image = Toy().rasters[:3]
    assert torch.equal(loaded.method.describe(image), model.method.describe(image))


def test_a_missing_or_foreign_checkpoint_is_one_clear_error(tmp_path):
    with pytest.raises(DeepringError, match="is no file"):
        load_deepring(tmp_path / "none.ckpt")
    (tmp_path / "junk.ckpt").write_bytes(b"not a checkpoint")
    with pytest.raises(DeepringError, match="is no DeepRING checkpoint"):
        load_deepring(tmp_path / "junk.ckpt")
    torch.save({"state_dict": {}}, tmp_path / "other.ckpt")
    with pytest.raises(DeepringError, match="is no DeepRING checkpoint"):
        load_deepring(tmp_path / "other.ckpt")


def test_bf16_trains_and_describes_in_float32(tmp_path):
    model = module()
    runner = fit(model, tmp_path, 1, precision="bf16-mixed")
    assert torch.isfinite(runner.callback_metrics["train/loss"])
    assert model.method.describe(Toy().rasters[:2]).dtype == torch.float32


def test_two_processes_train_on_different_episodes_and_agree(tmp_path):
    model = module()
    fit(model, tmp_path, 1, devices=2, strategy="ddp_spawn")
    assert (tmp_path / "last.ckpt").is_file()
    loaded = load_deepring(tmp_path / "last.ckpt").method
    assert all(torch.isfinite(p).all() for p in loaded.parameters())
