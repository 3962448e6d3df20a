"""Scans that lose a sector and cells: how much, where, and the same in every run."""

import numpy as np
import pytest
import torch

from deepring.errors import ConfigError
from deepring.rasters import BevRaster, HeightRaster, PolarRaster
from deepring.rasters.bev import bev_occupancy
from deepring.training.augmentation import Augmentation, AugmentedSet, cell_azimuths
from deepring.training.episodes import EpisodeScheme
from helpers.training_scans import RASTER, some_scans

FULL = torch.ones(400, 24, 24, dtype=torch.uint8)
AZIMUTH = cell_azimuths(BevRaster(cells=24))


def lost(augmentation, seed=0):
    """What each of the full scans lost, bool (n, 24, 24)."""
    return augmentation(FULL, AZIMUTH, np.random.default_rng(seed)) == 0


def test_azimuths_are_those_of_points_in_the_cells():
    for degrees in (10, 100, -35):
        angle = np.deg2rad(degrees)
        point = np.array([[30 * np.cos(angle), 30 * np.sin(angle), 1.0]], dtype=np.float32)
        cell = torch.from_numpy(bev_occupancy(point, 40, 24))
        assert abs(np.rad2deg(AZIMUTH[cell].item()) - degrees) < 5
    sectors = cell_azimuths(PolarRaster(sectors=8, rings=3))
    assert torch.allclose(sectors.rad2deg().flatten()[:2], torch.tensor([22.5, 67.5]).double())


def test_a_sector_is_lost_whole_and_has_its_width():
    scans = lost(Augmentation(blind=1.0, blind_width=(60, 90)))
    for one in scans[:50]:
        away = torch.sort(AZIMUTH[~one]).values
        gaps = torch.diff(away, append=away[:1] + 2 * torch.pi)
        assert 45 < gaps.max().rad2deg() < 105
    shares = scans.float().mean((1, 2))
    assert 60 / 360 - 0.03 < shares.min() < shares.max() < 90 / 360 + 0.03
    middles = torch.atan2((AZIMUTH.sin() * scans).sum((1, 2)), (AZIMUTH.cos() * scans).sum((1, 2)))
    assert torch.histc(middles.float(), 4, -torch.pi, torch.pi).min() > 60  # anywhere


def test_the_stated_share_of_scans_loses_a_sector():
    blind = lost(Augmentation(blind=0.3)).flatten(1).any(1).float().mean()
    assert 0.2 < blind < 0.4
    assert not lost(Augmentation()).any()


def test_each_scan_loses_its_own_share_of_cells_up_to_the_largest():
    shares = lost(Augmentation(dropped=0.4)).float().mean((1, 2))
    assert shares.max() < 0.5
    assert shares.min() < 0.05
    assert abs(shares.mean() - 0.2) < 0.02


def test_nothing_is_added_and_the_dtype_stays():
    rng = np.random.default_rng(1)
    scans = torch.from_numpy(rng.random((9, 24, 24)) < 0.1).to(torch.uint8)
    kept = Augmentation(blind=1.0, dropped=0.5)(scans, AZIMUTH, rng)
    assert kept.dtype == torch.uint8
    assert (kept <= scans).all()


def sets(**changes):
    scheme = EpisodeScheme(ways=3, queries=2, per_epoch=2)
    plain = scheme.training_set(some_scans(), seed=3)
    return plain, AugmentedSet(plain, Augmentation(**changes), RASTER, 3)


def test_a_batch_is_that_of_the_inner_set_but_for_what_it_loses():
    plain, changed = sets(blind=1.0, blind_width=(90, 91))
    assert len(changed) == len(plain)
    for index in (0, 5):
        assert torch.equal(changed[index].distances, plain[index].distances)
        assert (changed[index].rasters <= plain[index].rasters).all()
        assert changed[index].rasters.sum() < plain[index].rasters.sum()
        assert torch.equal(changed[index].rasters, changed[index].rasters)
    assert not torch.equal(changed[0].rasters, changed[1].rasters)


def test_the_inner_set_hears_of_epochs_and_keeps_its_state():
    class Listening:
        def __init__(self):
            self.heard = []

        def __getattr__(self, name):
            return lambda *args: self.heard.append((name, *args))

    inner = Listening()
    changed = AugmentedSet(inner, Augmentation(), RASTER, 0)
    changed.before_epoch(4, "method")
    changed.after_epoch({"a": 1.0})
    changed.state_dict()
    changed.load_state_dict({"b": 2})
    assert inner.heard == [
        ("before_epoch", 4, "method"),
        ("after_epoch", {"a": 1.0}),
        ("state_dict",),
        ("load_state_dict", {"b": 2}),
    ]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"blind": 1.5}, r"augmentation\.blind: 1\.5"),
        ({"dropped": -0.1}, r"augmentation\.dropped: -0\.1"),
        ({"blind_width": (90, 20)}, r"augmentation\.blind_width: \(90, 20\)"),
        ({"blind_width": (10, 400)}, r"augmentation\.blind_width: 400"),
    ],
)
def test_other_values_are_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        Augmentation(**values)


def test_rasters_whose_zero_is_no_absence_are_refused():
    with pytest.raises(ConfigError, match="augmentation: the method takes a HeightRaster"):
        cell_azimuths(HeightRaster())
