"""Episodes: the paper's distances hold, and the same seed gives the same episodes anywhere."""

import math
from itertools import combinations

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from torch.utils.data import DataLoader

from deepring.data.packed_rasters import Rasters, pack
from deepring.errors import DeepringError
from deepring.rasters import BevRaster
from deepring.training.batch_order import BatchOrder
from deepring.training.episodes import EpisodeScheme, EpisodeSet, Places
from deepring.training.training_scans import set_apart

RASTER = BevRaster(cells=8)


def places_of(positions, scheme, dataset=None):
    dataset = np.zeros(len(positions), dtype=np.int64) if dataset is None else dataset
    return Places(set_apart(positions, dataset), scheme)


def check_episode(scans, positions, dataset, episode):
    """The paper's rules, pair by pair."""
    assert scans.shape == (episode.ways, episode.shots + episode.queries)
    assert len(set(scans.ravel())) == scans.size
    for row in scans:
        assert len(set(dataset[row])) == 1
        for a, b in combinations(row, 2):
            assert math.dist(positions[a], positions[b]) <= episode.positive_radius
    for one, other in combinations(scans, 2):
        for a in one:
            for b in other:
                apart = math.dist(positions[a], positions[b])
                assert apart > episode.negative_radius or dataset[a] != dataset[b]


@settings(max_examples=150, deadline=None)
@given(
    # Positions on a grid of a quarter metre: distances compare exactly.
    clusters=st.lists(
        st.tuples(st.integers(-300, 300), st.integers(-300, 300)), min_size=2, max_size=12
    ),
    spread=st.integers(1, 60),
    owners=st.integers(1, 3),
    ways=st.integers(2, 4),
    shots=st.integers(1, 2),
    queries=st.integers(1, 3),
    same=st.sampled_from([5.0, 10.0]),
    gap=st.sampled_from([0.0, 10.0]),
    neighbours=st.sampled_from([0.0, 0.5]),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_episode_obeys_the_papers_distances(
    clusters, spread, owners, ways, shots, queries, same, gap, neighbours, seed
):
    radii = {"positive_radius": same, "negative_radius": same + gap}
    episode = EpisodeScheme(ways, shots, queries, **radii, neighbours=neighbours)
    rng = np.random.default_rng(seed)
    centres = np.repeat(np.array(clusters), 8, axis=0)
    positions = (centres + rng.integers(-spread, spread + 1, centres.shape)) / 4
    dataset = rng.integers(0, owners, len(positions))
    places = places_of(positions, episode, dataset)
    try:
        scans = places.sample(rng)
    except DeepringError:
        assume(False)
    check_episode(scans, positions, dataset, episode)


def street_grid(spacing=3.0):
    """Positions along three streets of 600 m, two of them parallel and 80 m apart."""
    x = np.arange(0.0, 600.0, spacing)
    zero = np.zeros_like(x)
    streets = [(x, zero), (x, zero + 80), (zero + 300, x - 300)]
    return np.concatenate([np.column_stack(street) for street in streets])


def drawn_anywhere(points, s, rng):
    """The classes of an episode as the paper draws them: anchors in random order, by loops."""
    apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
    crowded = np.flatnonzero((apart <= s.positive_radius).sum(axis=1) >= s.shots + s.queries)
    free, classes = np.ones(len(points), dtype=bool), []
    for anchor in rng.permutation(crowded):
        if not free[anchor] or len(classes) == s.ways:
            continue
        near = np.flatnonzero((apart[anchor] <= s.positive_radius) & free)
        members = [anchor]
        for scan in rng.permutation(near[near != anchor]):
            if (
                len(members) < s.shots + s.queries
                and max(apart[scan, members]) <= s.positive_radius
            ):
                members.append(scan)
        if len(members) == s.shots + s.queries:
            classes.append(rng.permutation(np.array(members)))
            free &= apart[members].min(axis=0) > s.negative_radius
    return np.stack(classes)


def test_without_neighbours_ways_are_drawn_anywhere_as_ever():
    positions, episode = street_grid(), EpisodeScheme(ways=8, queries=3)
    assert episode.neighbours == 0
    places = places_of(positions, episode)
    for seed in range(3):
        rng, again = np.random.default_rng(seed), np.random.default_rng(seed)
        assert np.array_equal(places.sample(rng), drawn_anywhere(places.points, episode, again))
        assert rng.random() == again.random()  # nothing else was drawn


def gaps_before(scans, positions, back):
    """From each way but the first the distance to the nearest of the ``back`` ways before it."""
    return [
        np.linalg.norm(
            positions[scans[way]][:, None] - positions[scans[max(0, way - back) : way].ravel()],
            axis=-1,
        ).min()
        for way in range(1, len(scans))
    ]


#: A street of 10 km: what is drawn anywhere is hardly ever near, and there is always room beside.
LONG = np.column_stack([np.arange(0.0, 10_000.0, 3.0), np.zeros(3334)])


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_as_many_ways_as_asked_lie_beside_one_of_the_last_three(share):
    episode = EpisodeScheme(ways=6, queries=2, neighbours=share)
    places, gaps = places_of(LONG, episode), []
    for seed in range(40):
        scans = places.sample(np.random.default_rng(seed))
        check_episode(scans, LONG, np.zeros(len(LONG)), episode)
        gaps += gaps_before(scans, LONG, back=3)
    assert min(gaps) > 20
    beside = np.mean(np.array(gaps) <= 35)
    assert beside == 1 if share == 1 else beside == pytest.approx(share, abs=0.1)


def test_the_same_seed_draws_the_same_neighbours():
    episode = EpisodeScheme(ways=6, queries=2, neighbours=0.5)
    a, b, other = (places_of(LONG, episode).sample(np.random.default_rng(k)) for k in (1, 1, 2))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, other)


def test_a_way_without_room_beside_it_is_followed_by_one_elsewhere():
    positions = np.repeat([[0.0, 0.0], [100.0, 0.0], [200.0, 0.0]], 4, axis=0)
    episode = EpisodeScheme(ways=3, queries=2, neighbours=1.0)
    scans = places_of(positions, episode).sample(np.random.default_rng(0))
    check_episode(scans, positions, np.zeros(len(positions)), episode)


def test_members_around_an_anchor_may_be_too_far_from_each_other():
    # Within 10 m of the middle scan, yet 16 m apart: the usual misreading puts them in one class.
    line = np.column_stack([[-8.0, 0.0, 8.0, 100.0, 101.0, 102.0], np.zeros(6)])
    places = places_of(line, EpisodeScheme(ways=2, shots=1, queries=2))
    assert len(places.near[1]) == 3
    with pytest.raises(DeepringError, match="only 1 places of 3 scans"):
        places.sample(np.random.default_rng(0))


def test_datasets_at_the_same_coordinates_are_different_places():
    rng = np.random.default_rng(0)
    positions = rng.uniform(-2, 2, (20, 2))
    dataset = np.arange(20) % 2
    episode = EpisodeScheme(ways=2, shots=1, queries=4)
    for _ in range(20):
        scans = places_of(positions, episode, dataset).sample(rng)
        assert {tuple(set(dataset[row])) for row in scans} == {(0,), (1,)}
    with pytest.raises(DeepringError, match="only 1 places"):
        places_of(positions, episode).sample(rng)


def test_every_scan_of_a_place_is_drawn_sooner_or_later_as_shot_and_as_query():
    positions = np.repeat([[0.0, 0.0], [50.0, 0.0]], 4, axis=0)
    episode = EpisodeScheme(ways=2, shots=1, queries=2)
    places, rng = places_of(positions, episode), np.random.default_rng(0)
    drawn = np.stack([places.sample(rng) for _ in range(60)])
    assert set(drawn[..., 0].ravel()) == set(range(8))
    assert set(drawn[..., 1:].ravel()) == set(range(8))


def test_too_few_places_are_told_in_numbers():
    positions = np.repeat([[0.0, 0.0], [50.0, 0.0], [100.0, 0.0]], 7, axis=0)
    places = places_of(positions, EpisodeScheme())
    with pytest.raises(DeepringError, match=r"^sampling\.ways: 24, .*21 scans") as caught:
        places.sample(np.random.default_rng(0))
    for part in ("only 3 places of 7 scans", "within 10 m", "beyond 20 m"):
        assert part in str(caught.value)


@pytest.mark.parametrize("n", [0, 1])
def test_almost_no_scan_is_too_few_places(n):
    with pytest.raises(DeepringError, match=r"sampling\.ways"):
        places_of(np.zeros((n, 2)), EpisodeScheme()).sample(np.random.default_rng(0))


@pytest.mark.parametrize(
    "bad",
    [
        {"ways": 1},
        {"shots": 0},
        {"queries": 0},
        {"per_epoch": 0},
        {"positive_radius": 0.0},
        {"positive_radius": -1.0},
        {"positive_radius": math.nan},
        {"positive_radius": 30.0},
        {"negative_radius": 5.0},
        {"negative_radius": math.nan},
        {"neighbours": -0.1},
        {"neighbours": 1.5},
        {"neighbours": math.nan},
        {"neighbour_radius": 0.0},
        {"neighbour_radius": 20.0, "neighbours": 0.5},
    ],
    ids=repr,
)
def test_bad_settings_are_named(bad):
    with pytest.raises(DeepringError, match=rf"sampling\.{next(iter(bad))}"):
        EpisodeScheme(**bad)


def numbered_scans(places=6, scans=5):
    """Scan k's image is k in binary, so that an episode tells which scans it holds."""
    positions = np.array([[40.0 * p + s, 0.0] for p in range(places) for s in range(scans)])
    images = [np.unpackbits(np.array([k] + [0] * 7, dtype=np.uint8)) for k in range(len(positions))]
    rasters = Rasters(
        np.stack([pack(i.reshape(8, 8).astype(bool), RASTER) for i in images]), RASTER
    )
    return positions, rasters


def number_of(images):
    return (images[..., 0, :].long() * 2 ** torch.arange(7, -1, -1)).sum(-1)


def dataset_of(seed):
    positions, rasters = numbered_scans()
    episode = EpisodeScheme(ways=3, shots=2, queries=2, per_epoch=4)
    return EpisodeSet(places_of(positions, episode), rasters, seed)


def test_images_of_an_episode_are_those_of_its_scans():
    episodes = dataset_of(seed=5)
    scans = torch.from_numpy(episodes.places.sample(np.random.default_rng([5, 17])))
    episode = episodes[17]
    support, query = episode.split(episode.rasters)
    assert support.shape == (3, 2, 8, 8)
    assert query.shape == (3, 2, 8, 8)
    assert torch.equal(number_of(support), scans[:, :2])
    assert torch.equal(number_of(query), scans[:, 2:])


@pytest.mark.filterwarnings("ignore:This DataLoader will create")  # on a machine of one core
@pytest.mark.parametrize("workers", [1, 2])
def test_same_seed_same_episodes_for_any_number_of_workers(workers):
    def drawn(workers, seed=0):
        loader = DataLoader(
            dataset_of(seed),
            batch_size=None,
            sampler=BatchOrder(4),
            num_workers=workers,
            multiprocessing_context="fork" if workers else None,
        )
        return [number_of(episode.rasters).tolist() for episode in loader]

    alone = drawn(0)
    assert len(alone) == 4
    assert drawn(workers) == alone
    assert drawn(0, seed=1) != alone


def test_episodes_of_an_epoch_and_of_different_epochs_differ():
    episodes, order = dataset_of(seed=0), BatchOrder(4)
    drawn = []
    for epoch in range(5):
        order.set_epoch(epoch)
        drawn += [number_of(episodes[k].rasters).tolist() for k in order]
    assert all(a != b for a, b in combinations(drawn, 2))
