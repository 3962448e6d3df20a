"""Streets: small maps in driving order, queries of another drive, and their distances."""

import logging
import math

import numpy as np
import pytest
import torch

from deepring.data.packed_rasters import Rasters
from deepring.errors import ConfigError, DataError
from deepring.rasters import BevRaster
from deepring.training.episodes import GradedCrossEntropy, OneShotCrossEntropy, SmoothAp
from deepring.training.streets import StreetScheme
from deepring.training.training_scans import TrainingScans

RASTER = BevRaster(cells=8)
SCHEME = StreetScheme(stretches=2, places=6, queries=10, spacing=(10.0, 14.0), per_epoch=4)


def drives(*sessions, dataset=None):
    """Training scans at the positions (n, 2) of each session; scan k's raster is k in binary."""
    number = np.repeat(np.arange(len(sessions)), [len(positions) for positions in sessions])
    of = np.zeros(len(number), dtype=np.int64) if dataset is None else np.array(dataset)[number]
    images = np.zeros((len(number), 8, 8), dtype=bool)
    for k in range(len(number)):
        images[k].flat[:16] = [(k >> bit) & 1 for bit in range(16)]
    rasters = Rasters(np.packbits(images.reshape(-1, 64), axis=1), RASTER)
    return TrainingScans(np.concatenate(sessions), of, np.zeros(len(of)), rasters, number)


def number_of(rasters):
    return (rasters.flatten(1)[:, :16].long() * 2 ** torch.arange(16)).sum(dim=1).numpy()


def line(length=600.0, step=2.0, y=0.0, start=0.0):
    x = np.arange(start, start + length, step)
    return np.column_stack([x, np.full_like(x, y)])


def two_sessions():
    """The same street of 600 m twice, in opposite directions and 3 m apart."""
    return drives(line(), line(y=3.0, start=1.0)[::-1])


def test_places_are_a_map_in_driving_order_and_queries_are_of_another_session():
    scans = two_sessions()
    streets = SCHEME.training_set(scans, seed=0)
    sessions = set()
    for index in range(8):
        places, queries = streets.sample(np.random.default_rng([0, index]))
        assert len({*places, *queries}) == len(places) + len(queries) == 12 + 20
        (session,) = set(scans.session[places])
        assert set(scans.session[queries]) == {1 - session}
        sessions.add(session)
        points = scans.positions[places]
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
        assert apart[~np.eye(12, dtype=bool)].min() > 10
        for stretch in places.reshape(2, 6):
            steps = np.diff(stretch) % 300  # the drive begins anew at its end
            assert (steps > 0).all()
            assert steps.sum() < 300
        nearest = np.linalg.norm(scans.positions[queries][:, None] - points[None], axis=-1).min(1)
        assert nearest.max() <= 10
    assert sessions == {0, 1}


def test_neighbouring_places_of_a_stretch_are_as_far_as_the_spacing():
    streets = SCHEME.training_set(two_sessions(), seed=0)
    gaps = []
    for index in range(20):
        first = streets.sample(np.random.default_rng(index))[0][:6]
        x = streets.scans.positions[first, 0]
        if abs(x[-1] - x[0]) < 100:  # not around the end of the drive
            gaps += np.abs(np.diff(x)).tolist()
    # Scans are 2 m apart, and the spacing is drawn from 10 to 14 m.
    assert {round(gap) for gap in gaps} == {12, 14}


def brute_force_passing(scans, place, radius, pass_apart):
    """What `StreetSet.passing` promises, scan by scan."""
    kinds = {"session": [], "pass": [], "own": []}
    for k in range(len(scans)):
        if k == place or scans.dataset[k] != scans.dataset[place]:
            continue
        if math.dist(scans.positions[k], scans.positions[place]) > radius:
            continue
        if scans.session[k] != scans.session[place]:
            kinds["session"].append(k)
            continue
        low, high = sorted((k, place))
        driven = sum(
            math.dist(scans.positions[i], scans.positions[i + 1]) for i in range(low, high)
        )
        kinds["pass" if driven > pass_apart else "own"].append(k)
    return kinds["session"] or kinds["pass"] or kinds["own"]


def test_a_place_s_queries_are_of_the_drive_that_differs_most():
    # Out and back; another session on the first third; another dataset at the same coordinates.
    out_and_back = np.concatenate([line(300, 6.0), line(240, 6.0, y=2.0)[::-1]])
    scans = drives(out_and_back, line(100, 6.0, y=1.0), line(300, 6.0), dataset=[0, 0, 1])
    scheme = StreetScheme(1, 4, 10, pass_apart=60.0)
    streets = scheme.training_set(scans, seed=0)
    kinds = set()
    for place in range(len(scans)):
        expected = brute_force_passing(scans, place, 10.0, 60.0)
        found = streets.passing(place)
        assert found.tolist() == expected
        kinds.add(tuple(sorted({*(scans.session[found] == scans.session[place])})))
    assert kinds == {(False,), (True,)}


def test_a_batch_holds_the_rasters_and_distances_of_its_scans():
    scans = two_sessions()
    streets = SCHEME.training_set(scans, seed=4)
    batch = streets[9]
    places, queries = streets.sample(np.random.default_rng([4, 9]))
    assert batch.places == 12
    assert number_of(batch.rasters).tolist() == [*places, *queries]
    for q, query in enumerate(queries):
        for p, place in enumerate(places):
            apart = math.dist(scans.positions[query], scans.positions[place])
            assert batch.distances[q, p].item() == pytest.approx(apart, rel=1e-6)


def test_places_of_other_datasets_are_far_and_never_right():
    scans = drives(*(line(y=y) for y in (0.0, 3.0, 0.0, 3.0)), dataset=[0, 0, 1, 1])
    streets = SCHEME.training_set(scans, seed=0)
    mixed = 0
    for index in range(8):
        places, queries = streets.sample(np.random.default_rng([0, index]))
        other = scans.dataset[queries][:, None] != scans.dataset[places][None]
        assert (streets[index].distances.numpy()[other] > 9e5).all()
        assert (
            GradedCrossEntropy().targets(streets[index].distances[:, :, None])[other] == 0
        ).all()
        for dataset in (0, 1):  # one session of each is the map
            assert len(set(scans.session[places[scans.dataset[places] == dataset]])) <= 1
        mixed += other.any()
    assert mixed


def test_the_same_seed_and_number_give_the_same_batch_and_others_do_not():
    def drawn(seed, index):
        return number_of(SCHEME.training_set(two_sessions(), seed)[index].rasters).tolist()

    assert drawn(0, 3) == drawn(0, 3)
    assert drawn(0, 3) != drawn(0, 4)
    assert drawn(0, 3) != drawn(1, 3)
    assert len(SCHEME.training_set(two_sessions(), 0)) == 4


def test_one_session_of_one_pass_is_warned_of(caplog):
    with caplog.at_level(logging.INFO):
        SCHEME.training_set(drives(line()), seed=0)
    assert "at 0, of another pass at 0 of 300" in caplog.text
    assert "all queries are of the same pass" in caplog.text
    caplog.clear()
    with caplog.at_level(logging.INFO):
        SCHEME.training_set(drives(np.concatenate([line(), line(y=3.0)[::-1]])), seed=0)
    assert "of another session at 0, of another pass at 5" in caplog.text
    assert "same pass" not in caplog.text


@pytest.mark.parametrize("length", [0.0, 2.0, 40.0, 110.0])
def test_streets_that_are_too_short_are_told_in_numbers(length):
    with pytest.raises(DataError, match=r"^sampling\.places: 2 stretches of 6 places, .* only \d"):
        SCHEME.training_set(drives(line(length), line(length, y=2.0)), seed=0)


@pytest.mark.parametrize(
    "bad",
    [
        {"stretches": 0},
        {"places": 1},
        {"queries": 0},
        {"per_epoch": 0},
        {"spacing": (0.0, 20.0)},
        {"spacing": (20.0, 10.0)},
        {"positive_radius": 0.0},
        {"pass_apart": math.nan},
    ],
    ids=repr,
)
def test_bad_settings_are_named(bad):
    with pytest.raises(ConfigError, match=rf"^sampling\.{next(iter(bad))}"):
        StreetScheme(**bad)


class ByPosition:
    """A method that reads each scan's position out of its raster."""

    def __init__(self, scans):
        self.positions = torch.from_numpy(scans.positions).float()

    def __call__(self, rasters):
        return self.positions[torch.from_numpy(number_of(rasters))]

    def score(self, queries, database):
        return -torch.cdist(queries, database)


@pytest.mark.parametrize("loss", [GradedCrossEntropy(1.0), SmoothAp()])
def test_a_method_that_knows_where_it_is_has_every_query_right(loss):
    scans = two_sessions()
    batch = SCHEME.training_set(scans, seed=0)[0]
    step = SCHEME.step(ByPosition(scans), loss, batch)
    assert step.accuracy == 1
    if isinstance(loss, SmoothAp):
        assert step.loss.item() == pytest.approx(0, abs=1e-3)
    elsewhere = batch._replace(distances=batch.distances.flip(1))
    assert SCHEME.step(ByPosition(scans), loss, elsewhere).loss > step.loss + 0.1


def test_losses_of_one_right_way_are_refused():
    SCHEME.expect_loss(SmoothAp())
    with pytest.raises(ConfigError, match="expected a subclass of GradedLoss"):
        SCHEME.expect_loss(OneShotCrossEntropy())
