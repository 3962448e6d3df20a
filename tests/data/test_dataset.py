"""A dataset's splits: regions apart, spacings kept, revisits found, yaws seeded, errors named."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial import KDTree

from deepring.data import dataset as dataset_module
from deepring.data.dataset import DatasetConfig, PlaceDataset, Regions, Spacing, distances_between
from deepring.data.scan_set import ScanSet
from deepring.data.session import Session
from deepring.errors import DeepringError

# The simulated world's halves: train west of 0 m, test east of 150 m (north, east).
TRAIN = [{"half_plane": {"point": [0, 0], "normal": [-1, 0]}}]
TEST = [{"half_plane": {"point": [150, 0], "normal": [1, 0]}}]
REGIONS = Regions(train=TRAIN, test=TEST, margin=12.0)


@pytest.fixture
def config(tiny_nclt):
    return DatasetConfig(
        name="sim",
        format="nclt",
        root=str(tiny_nclt),
        database="2031-02-04",
        query="2031-03-17",
        spacing=Spacing(database=20.0, query=5.0, train=2.0),
        regions=REGIONS,
    )


def truth_of(scan_sets):
    return np.concatenate([scans.ground_truth for scans in scan_sets])


def apart(one, other):
    """The smallest distance between two sets of positions."""
    return KDTree(one).query(other)[0].min()


def validation_scans(dataset):
    """Every scan of either session that validation may use, before any spacing."""
    sessions = (dataset.database, dataset.query)
    return np.concatenate([s.ground_truth[dataset.mask("validation", s)] for s in sessions])


def test_training_keeps_the_margin_from_every_validation_scan(config):
    dataset = PlaceDataset(config)
    train, held_out = truth_of(dataset.training()), validation_scans(dataset)
    assert len(train) > 10
    assert len(held_out) > 5
    assert apart(held_out, train) > 12.0
    # The margin is what keeps them apart: without it they touch.
    tight = PlaceDataset(replace(config, regions=replace(REGIONS, margin=0.0)))
    assert apart(validation_scans(tight), truth_of(tight.training())) < 12.0
    assert len(truth_of(tight.training())) > len(train)


def test_validation_is_cut_out_of_the_training_region(config):
    dataset = PlaceDataset(config)
    for session in (dataset.database, dataset.query):
        validation, test = (dataset.mask(region, session) for region in ("validation", "test"))
        assert (session.ground_truth[validation, 0] <= 0).all()
        assert not (validation & dataset.mask("train", session)).any()
        assert not (validation & test).any()


def test_validation_holds_its_share_of_the_training_regions_database(config):
    dataset = PlaceDataset(replace(config, regions=replace(REGIONS, validation_share=0.3)))
    inside = dataset.database.ground_truth[:, 0] <= 0
    held_out = dataset.mask("validation", dataset.database)
    assert abs(held_out.sum() - 0.3 * inside.sum()) <= 1


def test_training_and_test_are_far_apart(config):
    dataset = PlaceDataset(config)
    split = dataset.retrieval("test")
    assert apart(truth_of([split.database, split.query]), truth_of(dataset.training())) >= 140


def test_training_takes_both_sessions_at_their_spacing(config):
    dataset = PlaceDataset(replace(config, spacing=Spacing(train=8.0)))
    first, second = dataset.training()
    assert (first.session.name, second.session.name) == ("2031-02-04", "2031-03-17")
    for scans in (first, second):
        steps = np.hypot(*np.diff(scans.positions, axis=0).T)
        assert (steps > 8.0).all()


@pytest.mark.parametrize("region", ["validation", "test", "whole"])
def test_retrieval_sets_keep_their_regions_and_spacings(config, region):
    dataset = PlaceDataset(config)
    split = dataset.retrieval(region)
    assert (split.name, split.region) == ("sim", region)
    assert (split.database.session, split.query.session) == (dataset.database, dataset.query)
    for scans, spacing in ((split.database, 20.0), (split.query, 5.0)):
        assert dataset.mask(region, scans.session)[scans.indices].all()
        assert (np.hypot(*np.diff(scans.positions, axis=0).T) > spacing).all()
        # No scan that could have been kept is missing.
        allowed = np.flatnonzero(dataset.mask(region, scans.session))
        for start, end in zip(scans.indices, [*scans.indices[1:], len(scans.session)], strict=True):
            skipped = allowed[(allowed > start) & (allowed < end)]
            offset = scans.session.positions[skipped] - scans.session.positions[start]
            assert (np.hypot(*offset.T) <= spacing).all()
    assert len(split.query) > len(split.database)


def test_whole_is_everything_and_a_region_left_out_too(config):
    dataset = PlaceDataset(config)
    assert dataset.mask("whole", dataset.query).all()
    anywhere = PlaceDataset(replace(config, regions=Regions()))
    assert anywhere.mask("test", anywhere.query).all()


def test_regions_are_stated_in_ground_truth_and_not_in_world_coordinates(config):
    # NCLT's second coordinate is east, the world's is west: a region north-east of a crossing.
    east = [{"half_plane": {"point": [0, 5], "normal": [0, 1]}}]
    dataset = PlaceDataset(replace(config, regions=Regions(test=east)))
    scans = dataset.retrieval("test").query
    assert (scans.ground_truth[:, 1] >= 5).all()
    assert (scans.positions[:, 1] <= -5).all()


def test_explicit_validation_replaces_the_share(config):
    north = [{"half_plane": {"point": [0, 10], "normal": [0, 1]}}]
    regions = replace(REGIONS, validation=north, margin=5.0)
    dataset = PlaceDataset(replace(config, regions=regions))
    held_out = validation_scans(dataset)
    assert (held_out[:, 1] >= 10).all()
    assert (held_out[:, 0] <= 0).all()  # still inside the training region
    assert apart(held_out, truth_of(dataset.training())) > 5.0


def test_no_validation_gives_all_to_training(config):
    dataset = PlaceDataset(replace(config, regions=replace(REGIONS, validation_share=0.0)))
    assert not dataset.has_validation
    inside = dataset.database.ground_truth[:, 0] <= 0
    assert np.array_equal(dataset.mask("train", dataset.database), inside)
    with pytest.raises(DeepringError, match=r"data\.regions\.validation_share: 0"):
        dataset.retrieval("validation")
    assert PlaceDataset(config).has_validation


@pytest.mark.parametrize("share", [-0.1, 1.0, float("nan")])
def test_a_bad_share_is_named(config, share):
    dataset = PlaceDataset(replace(config, regions=replace(REGIONS, validation_share=share)))
    with pytest.raises(DeepringError, match=r"data\.regions\.validation_share"):
        dataset.training()


@pytest.mark.parametrize("split", ["session", "", None])
def test_a_bad_split_is_named(split):
    with pytest.raises(DeepringError, match=r"data\.split"):
        PlaceDataset(DatasetConfig(split=split))


@pytest.mark.parametrize("region", ["train", "test"])
def test_a_region_without_scans_is_an_error_with_the_sessions_span(config, region):
    nowhere = [{"disc": {"center": [5000, 5000], "radius": 10}}]
    dataset = PlaceDataset(replace(config, regions=replace(REGIONS, **{region: nowhere})))
    with pytest.raises(DeepringError, match=rf"data\.regions\.{region}:") as caught:
        dataset.training() if region == "train" else dataset.retrieval("test")
    low, high = dataset.database.ground_truth.min(0), dataset.database.ground_truth.max(0)
    for value in (*low, *high):
        assert f"{value:.1f}" in str(caught.value)
    assert "2031-02-04" in str(caught.value)


def test_a_margin_that_leaves_no_training_scan_is_an_error(config):
    dataset = PlaceDataset(replace(config, regions=replace(REGIONS, margin=500.0)))
    with pytest.raises(DeepringError, match=r"data\.regions\.train:"):
        dataset.training()


def test_query_yaws_are_seeded_and_cover_the_turn(config):
    def turns(seed):
        return PlaceDataset(replace(config, query_turn_seed=seed)).retrieval("whole")

    first = turns(3)
    assert np.array_equal(first.query.turns, turns(3).query.turns)
    assert not np.array_equal(first.query.turns, turns(4).query.turns)
    assert first.query.turns.shape == (len(first.query),)
    assert (first.query.turns >= 0).all()
    assert (first.query.turns < 2 * np.pi).all()
    assert np.histogram(first.query.turns, 4, (0, 2 * np.pi))[0].min() > 0
    assert first.database.turns is None
    assert turns(None).query.turns is None


def laps(n=240, rounds=2, name="laps"):
    """A session of two rounds of a circle of 60 m, in world and ground truth apart."""
    angle = np.linspace(0, 2 * np.pi * rounds, n, endpoint=False)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :2, 3] = 60 * np.column_stack([np.cos(angle), np.sin(angle)])
    return Session(name, (None,) * n, poses, poses[:, :2, 3] + 1000.0, None, read=None)


@pytest.fixture
def revisited(monkeypatch):
    def make(session, **changes):
        monkeypatch.setattr(dataset_module, "open_session", lambda *_, **__: session)
        monkeypatch.setattr(dataset_module, "expect_usable", lambda *_: [])  # without files
        regions = Regions(validation_share=0.0)
        return PlaceDataset(
            DatasetConfig(**{"name": "laps", "split": "revisits", "regions": regions, **changes})
        )

    return make


def test_revisits_are_the_queries_and_first_passes_the_database(revisited):
    split = revisited(laps(), spacing=Spacing(database=20, query=5)).retrieval("whole")
    assert split.query.session is split.database.session
    # Scans are 3.1 m apart: the last four of the first round see its first ones again.
    assert split.database.indices.max() < 116 < split.query.indices.min() <= 118
    assert len(split.query) > 3 * len(split.database) > 30
    nearest = KDTree(split.database.positions).query(split.query.positions)[0]
    assert (nearest < 20).all()


def test_revisits_train_on_the_one_session_once(revisited):
    dataset = revisited(laps())
    assert len(dataset.training()) == 1
    assert dataset.query is dataset.database


def test_revisits_obey_the_region(revisited):
    region = [{"half_plane": {"point": [1000, 1000], "normal": [1, 0]}}]
    regions = Regions(test=region, validation_share=0.0)
    split = revisited(laps(), regions=regions).retrieval("test")
    assert (truth_of([split.database, split.query])[:, 0] >= 1000).all()


def test_a_drive_without_revisits_says_so(revisited):
    with pytest.raises(DeepringError, match=r"data\.split.*laps.*revisit_apart=100 m"):
        revisited(laps(rounds=1, n=100), revisit_radius=1.0).retrieval("whole")


def test_the_ground_is_the_configs_or_else_the_sessions(revisited):
    knows = replace(laps(), ground_z=-1.2)
    for session, ground_z, expected in ((knows, None, -1.2), (knows, -2.0, -2.0), (laps(), 0, 0)):
        split = revisited(session, ground_z=ground_z).retrieval("whole")
        assert split.database.ground_z == split.query.ground_z == expected
    with pytest.raises(DeepringError, match=r"data\.ground_z: null, but session laps"):
        revisited(laps(), ground_z=None).retrieval("whole")


def test_distances_are_taken_in_float64():
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :2, 3] = np.array([[0.0, 0], [3, 4], [0.01, 0]]) + np.array([345090.0743, 4037591.323])
    session = Session("utm", (None,) * 3, poses, poses[:, :2, 3], None, read=None)
    database = ScanSet(session, np.array([0, 1]))
    distances = distances_between(session.positions[2:], database)
    assert distances.dtype == torch.float32
    assert distances[0].tolist() == pytest.approx([0.01, np.hypot(2.99, 4)], rel=1e-6)
    coarse = torch.from_numpy(session.positions).float()
    assert torch.linalg.vector_norm(coarse[2] - coarse[0]) != pytest.approx(0.01, rel=0.1)


def test_messages_begin_where_the_config_stands(config):
    with pytest.raises(DeepringError, match=r"^test_data\.nclt\.split: 'both'"):
        PlaceDataset(replace(config, split="both"), "test_data.nclt")
    nowhere = [{"disc": {"center": [5000, 5000], "radius": 10}}]
    dataset = PlaceDataset(replace(config, regions=Regions(test=nowhere)), "test_data.nclt")
    with pytest.raises(
        DeepringError, match=r"^test_data\.nclt\.regions\.test: contains no usable scan"
    ):
        dataset.retrieval("test")


def test_a_session_that_would_find_itself_is_refused(tiny_nclt):
    config = DatasetConfig(
        name="same",
        format="nclt",
        root=str(tiny_nclt),
        database="2031-02-04",
        query="2031-02-04",
    )
    with pytest.raises(DeepringError, match=r"data\.query: 2031-02-04"):
        PlaceDataset(config).retrieval("whole")
