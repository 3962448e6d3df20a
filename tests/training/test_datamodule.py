"""The datamodule: several datasets, episodes of an epoch, validation sets, workers."""

import numpy as np
import pytest
import torch

from deepring.data.cache import RasterCache
from deepring.data.dataset import DatasetConfig, PlaceDataset, Regions, Spacing
from deepring.rasters import BevRaster
from deepring.training.datamodule import PlaceDataModule
from deepring.training.episodes import EpisodeScheme
from deepring.training.streets import StreetScheme

EPISODE = EpisodeScheme(ways=2, shots=1, queries=2, per_epoch=3)


def dataset(name, root, **regions):
    nclt = name == "nclt"
    return PlaceDataset(
        DatasetConfig(
            name=name,
            format=name,
            root=str(root),
            database="2031-02-04" if nclt else "SimCity01",
            query="2031-03-17" if nclt else "SimCity02",
            spacing=Spacing(train=1.0),
            regions=Regions(validation_share=0.3, margin=1.0, **regions),
            ground_z=0.0 if nclt else -1.8,
        )
    )


@pytest.fixture
def datamodule(tiny_nclt, tiny_mulran, tmp_path):
    def make(seed=0, workers=0, share=0.3, scheme=EPISODE):
        datasets = [dataset("nclt", tiny_nclt), dataset("mulran", tiny_mulran)]
        for each in datasets:
            each.config.regions.validation_share = share
        made = PlaceDataModule(
            datasets, BevRaster(cells=40), scheme, RasterCache(tmp_path), seed, workers
        )
        made.prepare_data()
        made.setup("fit")
        return made

    return make


def drawn(datamodule, epoch=0):
    loader = datamodule.train_dataloader()
    loader.sampler.set_epoch(epoch)
    return list(loader)


def same(a, b):
    return all(torch.equal(x.rasters, y.rasters) for x, y in zip(a, b, strict=True))


def test_an_epoch_holds_its_episodes_with_images_of_the_raster(datamodule):
    episodes = drawn(datamodule())
    assert len(episodes) == 3
    support, query = episodes[0].split(episodes[0].rasters)
    assert support.shape == (2, 1, 40, 40)
    assert query.shape == (2, 2, 40, 40)
    assert all(episode.rasters.flatten(1).any(dim=1).all() for episode in episodes)


def test_workers_do_not_change_the_episodes_and_seeds_and_epochs_do(datamodule):
    here, there = drawn(datamodule()), drawn(datamodule(workers=2))
    assert same(here, there)
    assert not same(here, drawn(datamodule(seed=1)))
    assert not same(here, drawn(datamodule(), epoch=1))


def test_places_of_different_datasets_share_no_class(datamodule):
    made = datamodule()
    places = made.train_set.places
    rng = np.random.default_rng(0)
    owners = places.points[:, 2]
    seen = set()
    for _ in range(30):
        classes = owners[places.sample(rng)]
        assert (classes == classes[:, :1]).all()
        seen.update(classes.ravel())
    assert seen == {0.0, 1e6}


def test_each_dataset_has_its_validation_set_apart_from_training(datamodule):
    made = datamodule()
    assert list(made.validation) == ["nclt", "mulran"]
    assert len(made.val_dataloader()) == 2
    batch = made.validation["nclt"]
    assert batch.distances.shape == (len(batch.query), len(batch.database))
    for each in made.datasets:
        held_out = each.retrieval("validation")
        for scans in each.training():
            for side in (held_out.database, held_out.query):
                apart = np.linalg.norm(scans.positions[:, None] - side.positions[None], axis=-1)
                assert apart.min() > 1.0


def test_without_a_validation_share_there_is_no_validation(datamodule):
    assert datamodule(share=0.0).validation == {}


def test_sessions_are_numbered_over_all_datasets_each_in_driving_order(datamodule):
    made = datamodule(scheme=StreetScheme(1, 2, 4, spacing=(5.0, 8.0)))
    scans = made.train_set.scans
    sessions = [scans for dataset in made.datasets for scans in dataset.training()]
    assert np.array_equal(scans.session, np.repeat(range(4), [len(one) for one in sessions]))
    assert np.array_equal(scans.dataset, scans.session // 2)
    for number, one in enumerate(sessions):
        origin = made.datasets[number // 2].database.positions[0]
        assert np.allclose(scans.positions[scans.session == number], one.positions - origin)
