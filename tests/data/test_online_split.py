"""Online queries are compared with what is earlier by as much as the config says, and no more."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import deepring.data.dataset as dataset_module
from deepring.data.dataset import DatasetConfig, PlaceDataset, Regions, RetrievalSet, Spacing
from deepring.data.online import Earlier, first_too_recent
from deepring.data.scan_set import ScanSet
from deepring.data.session import Session
from deepring.errors import DeepringError


def drive(n=60, seed=0, stamps=True):
    """Steps of 0 to 4 m and 0 to 2 s along a wandering path."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :2, 3] = rng.uniform(-2, 2, (n, 2)).cumsum(axis=0)
    seconds = rng.integers(0, 3, n).cumsum()
    times = seconds * 10**9 if stamps else None
    return Session("drive", (None,) * n, poses, poses[:, :2, 3] + 500.0, times, read=None)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.integers(0, 5),
    st.integers(1, 4),
    st.integers(1, 3),
    st.one_of(st.none(), st.integers(0, 40).map(float)),
    st.one_of(st.none(), st.floats(0, 60)),
    st.one_of(st.none(), st.integers(1, 12)),
)
def test_places_are_those_that_are_earlier_by_all_that_is_given(
    seed, every_place, every_query, seconds, metres, keyframes
):
    session = drive(seed=seed)
    places, queries = np.arange(0, 60, every_place), np.arange(0, 60, every_query)
    before = first_too_recent(session, places, queries, Earlier(seconds, metres, keyframes), "k")
    steps = np.linalg.norm(np.diff(session.positions, axis=0), axis=1)
    for query, first in zip(queries, before, strict=True):
        for number, place in enumerate(places):
            old = place < query  # never itself, whatever is given
            if seconds is not None:
                old &= session.stamps[query] - session.stamps[place] >= seconds * 1e9
            if metres is not None:
                path = np.concatenate([[0], np.cumsum(steps)])
                old &= path[place] <= path[query] - metres
            if keyframes is not None:
                old &= (places < query).sum() - number >= keyframes
            assert (place < first) == old
    assert (np.diff(before) >= 0).all()


@pytest.fixture
def online(monkeypatch):
    def make(session, earlier, **changes):
        monkeypatch.setattr(dataset_module, "open_session", lambda *_, **__: session)
        monkeypatch.setattr(dataset_module, "expect_usable", lambda *_: [])  # without files
        spacing = changes.pop("spacing", Spacing(0, 0, 0))
        config = {"split": "online", "regions": Regions(validation_share=0.0), "spacing": spacing}
        return PlaceDataset(
            DatasetConfig("d", "kitti", "/", earlier=Earlier(**earlier), **{**config, **changes})
        )

    return make


def test_each_scan_is_a_query_and_later_a_place(online):
    split = online(drive(), {"keyframes": 10}).retrieval("whole")
    assert split.database.indices.tolist() == list(range(60))
    assert split.query.indices.tolist() == list(range(10, 60)), "the first ten see nothing"
    assert split.searched.tolist() == list(range(1, 51)), "the tenth before it is old enough"


def test_places_and_queries_have_their_own_spacings(online):
    split = online(drive(), {"seconds": 8}, spacing=Spacing(6, 2, 0)).retrieval("whole")
    assert len(split.database) < len(split.query)
    oldest = split.database.indices[split.searched - 1]
    stamps = drive().stamps
    assert (stamps[split.query.indices] - stamps[oldest] >= 8e9).all()


def test_the_region_holds_for_both(online):
    region = [{"half_plane": {"point": [500, 500], "normal": [0, -1]}}]
    regions = Regions(test=region, validation_share=0.0)
    split = online(drive(), {"keyframes": 3}, regions=regions).retrieval("test")
    assert (split.database.ground_truth[:, 1] <= 500).all()
    assert (split.query.ground_truth[:, 1] <= 500).all()
    assert len(split.query) == len(split.database) - 3


def test_it_trains_on_the_one_drive_once(online):
    dataset = online(drive(), {"metres": 20})
    assert len(dataset.training()) == 1
    assert dataset.query is dataset.database


def test_scans_that_cannot_be_read_leave_queries_without_a_place_behind():
    session = drive(6)
    every = ScanSet(session, np.arange(6))
    before = np.array([1, 1, 2, 5])
    split = RetrievalSet("d", "whole", every, ScanSet(session, np.arange(2, 6)), before)
    some = every.subset(np.array([False, True, True, True, True, True]))
    left = split.among(some, split.query.subset(np.array([True, True, True, True])))
    assert left.query.indices.tolist() == [4, 5]
    assert left.before.tolist() == [2, 5]
    assert left.searched.tolist() == [1, 4]
    both = RetrievalSet("d", "whole", every, split.query)
    assert both.searched is both.among(some, split.query).searched is None


def test_what_is_not_said_or_not_there_is_refused(online):
    with pytest.raises(DeepringError, match=r"data\.earlier: nothing, expected seconds, metres or"):
        online(drive(), {})
    with pytest.raises(DeepringError, match=r"data\.earlier\.seconds: 30, expected only with spl"):
        online(drive(), {"seconds": 30}, split="revisits")
    with pytest.raises(DeepringError, match=r"data\.earlier\.keyframes: 0, expected a whole"):
        online(drive(), {"keyframes": 0})
    with pytest.raises(DeepringError, match=r"data\.earlier\.metres: -1, expected a number of"):
        online(drive(), {"metres": -1})
    with pytest.raises(DeepringError, match=r"data\.earlier\.seconds: 30, but session drive has"):
        online(drive(stamps=False), {"seconds": 30}).retrieval("whole")
    with pytest.raises(
        DeepringError, match=r"data\.earlier: \{'metres': 1000000\.0\}, but none of 60"
    ):
        online(drive(), {"metres": 1e6}).retrieval("whole")
