"""Places of a map: what was added comes back, and nothing is copied twice as often as it grows."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import pose_from, rotation_from_rpy, yaw_of
from deepring.errors import DataError
from deepring.localization.place_store import PlaceStore
from deepring.rasters import BevRaster

RASTER = BevRaster(cells=9)


def some(count, seed=0):
    """Images, poses and names."""
    rng = np.random.default_rng(seed)
    yaws = rng.uniform(-math.pi, math.pi, count)
    poses = pose_from(rotation_from_rpy(0 * yaws, 0 * yaws, yaws), rng.normal(size=(count, 3)))
    return rng.random((count, 9, 9)) < 0.3, poses, [f"{seed}_{k}" for k in range(count)]


@settings(deadline=None, max_examples=30)
@given(st.lists(st.integers(0, 5), min_size=1, max_size=6), st.integers(0, 9))
def test_what_was_added_comes_back_whenever_it_was(counts, restored_after):
    store, parts = PlaceStore(RASTER), []
    for seed, count in enumerate(counts):
        parts.append(some(count, seed))
        store.add(*parts[-1])
        if seed == restored_after:  # from here on it grows behind what a file holds
            names, tensors, store = store.names, store.tensors(), PlaceStore(RASTER)
            store.restore(**tensors, names=names)
    images, poses = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    assert store.names == [name for part in parts for name in part[2]]
    assert len(store) == len(poses)
    np.testing.assert_array_equal(store.poses, poses)
    np.testing.assert_array_equal(store.positions, poses[:, :2, 3])
    if len(store):
        chosen = torch.randperm(len(store))[: len(store) // 2 + 1]
        np.testing.assert_array_equal(store.images(chosen).numpy(), images[chosen.numpy()])
        planar = store.planar_poses(chosen).numpy()
        np.testing.assert_array_equal(planar[:, :2], poses[chosen.numpy()][:, :2, 3])
        np.testing.assert_array_equal(planar[:, 2], yaw_of(poses[chosen.numpy()]))


def test_adding_places_one_by_one_takes_linear_work(monkeypatch):
    copied = 0
    copy = torch.Tensor.copy_

    def counted(self, other, *args):
        nonlocal copied
        copied += other.numel() * other.element_size()
        return copy(self, other, *args)

    monkeypatch.setattr(torch.Tensor, "copy_", counted)
    store = PlaceStore(RASTER)
    for k in range(600):
        store.add(*some(1, k))
    size = sum(tensor.nbytes for tensor in store.tensors().values())
    assert size <= copied < 4 * size  # copying all others each time takes 300 times the size


def test_restored_tensors_are_not_copied():
    store, again = PlaceStore(RASTER), PlaceStore(RASTER)
    store.add(*some(5))
    tensors = store.tensors()
    again.restore(**tensors, names=store.names)
    tensors["poses"][3, 0, 3] = 77.0
    assert again.positions[3, 0] == 77.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda images, poses, names: (images, poses, names[1:]), "2 names"),
        (lambda images, poses, names: (images, poses[1:], names), r"poses \(2, 4, 4\)"),
        (lambda images, poses, names: (images[1:], poses, names), r"images \(2, 11\)"),
        (lambda images, poses, names: (images, poses[:, :3], names), r"poses \(3, 3, 4\)"),
        (lambda images, poses, names: (images, poses * np.nan, names), "not finite"),
    ],
)
def test_places_that_do_not_fit_are_refused_and_none_is_added(change, message):
    store = PlaceStore(RASTER)
    with pytest.raises(DataError, match=message):
        store.add(*change(*some(3)))
    assert len(store) == 0
    store.add(*some(3))
    assert len(store) == 3


def test_images_of_another_size_are_refused():
    store, other = PlaceStore(RASTER), PlaceStore(BevRaster(cells=15))
    store.add(*some(3))
    with pytest.raises(DataError, match=r"images \(3, 11\)"):
        other.restore(**store.tensors(), names=store.names)
