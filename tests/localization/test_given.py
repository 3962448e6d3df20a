"""What callers give a map: what is like an array is taken, and all else leaves a map unchanged."""

import fractions
import math
import warnings
from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from deepring.core.arrays import real_array
from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.session import Session
from deepring.errors import BrokenScanError, ConfigError, DataError, DeepringError, FileError
from deepring.localization.calibration import concatenate, run_trials
from deepring.localization.drives.loops import LoopSettings, find_loops
from deepring.localization.location import AcceptanceThresholds
from deepring.localization.map import Map
from deepring.localization.map_building import build_map
from deepring.localization.observation import Observation
from deepring.localization.scan_points import scan_points
from helpers.networks import small_network
from helpers.scenes import scattered

SCENE = scattered(0)
EYE = np.eye(4)[None]
POSES = pose_from(rotation_from_rpy(0, 0, np.arange(3)), np.arange(9.0).reshape(3, 3) * 20)
NETWORK = small_network()


def filled_map():
    place_map = Map(NETWORK)
    place_map.add([scattered(k) for k in range(3)], POSES, list("abc"))
    return place_map


PLACE_MAP = filled_map()
KNOWN = PLACE_MAP.localize(SCENE)


def state_of(place_map):
    """Everything of a map that adding a place could change, as plain values."""
    blocks = place_map.index.places.blocks()
    return (
        place_map.places.names[:],
        {name: value.numpy().tobytes() for name, value in place_map.places.tensors().items()},
        [{name: value.numpy().tobytes() for name, value in block.items()} for block in blocks],
        place_map.index.shape,
        place_map.index.code is None,
    )


holes = np.insert(SCENE, [0, 5, 9], [[np.nan] * 3, [0, 0, 0], [np.inf, 1, 1]], axis=0)
masked = np.ma.masked_invalid(holes)
Row = namedtuple("Row", "x y z")


@pytest.mark.parametrize(
    "points",
    [
        SCENE.astype(np.float64),
        SCENE.astype(">f4"),
        SCENE.astype(np.longdouble),
        SCENE.astype(object),
        SCENE.tolist(),
        [Row(*point) for point in SCENE.tolist()],
        tuple(map(tuple, SCENE.tolist())),
        list(SCENE),
        [torch.from_numpy(point) for point in SCENE[:]],
        torch.from_numpy(SCENE),
        torch.from_numpy(SCENE).double().requires_grad_(),
        np.asfortranarray(SCENE),
        np.repeat(SCENE, 2, axis=0)[::2],
        np.hstack([SCENE, np.full((len(SCENE), 2), 1e300)]),
        holes,
        torch.from_numpy(holes),
        holes.tolist(),
        masked,
        np.insert(SCENE.astype(np.float64), 4, [1e300, -1e300, 0], axis=0),
    ],
    ids=lambda points: type(points).__name__,
)
def test_what_is_like_an_array_of_points_is_located_as_the_array(points):
    assert PLACE_MAP.localize(points) == KNOWN


def test_types_that_round_are_located_nearby():
    for points in (
        SCENE.astype(np.float16),
        torch.from_numpy(SCENE).bfloat16(),
        (SCENE * 2).round().astype(np.int16) // 2,
        [[fractions.Fraction(float(value)) for value in point] for point in SCENE],
    ):
        location = PLACE_MAP.localize(points)
        assert location.name == KNOWN.name
        assert math.hypot(location.x - KNOWN.x, location.y - KNOWN.y) < 1.5


structured = np.zeros(9, [("x", "f4"), ("y", "f4"), ("z", "f4")])


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (SCENE.T, "give its transpose"),
        (SCENE[:, :2], r"\(\d+, 2\), expected \(n, 3\)"),
        (SCENE[:, 0], r"expected \(n, 3\)"),
        (SCENE[None], r"expected \(n, 3\)"),
        (np.zeros((3, 3, 64)), r"expected \(n, 3\)"),
        (SCENE[:0], "no points"),
        ([], r"shape \(0,\)"),
        (SCENE * np.nan, "all missing returns"),
        (SCENE + 0j, "complex64"),
        (torch.from_numpy(SCENE) + 0j, "complex64"),
        (SCENE > 0, "an array of bool"),
        (SCENE.astype(str), "an array of <U"),
        (SCENE.astype(str).astype(object), "an array of object"),
        (structured, "an array of .*'x'"),
        ([[1, 2, 3], [1, 2]], "a list, expected an array"),
        ([[1, 2, None]], "an array of object"),
        ([[10**400, 1, 2]], "beyond float64"),
        (np.zeros((4, 3), "M8[s]"), "datetime64"),
        ("points.npy", "an array of <U10"),
        (b"1 2 3", "an array of"),
        (None, "an array of object"),
        (7, r"shape \(\)"),
        ({"x": 1}, "an array of object"),
        ((point for point in SCENE), "an array of object"),
        (torch.from_numpy(SCENE).to("meta"), "a Tensor, expected an array"),
        (torch.from_numpy(SCENE).to_sparse(), "a Tensor, expected an array"),
    ],
)
def test_everything_else_is_refused_with_what_was_expected(points, words):
    with pytest.raises(DataError, match=f"^scan: .*{words}"):
        PLACE_MAP.localize(points)
    assert PLACE_MAP.localize(SCENE) == KNOWN


def test_an_object_that_raises_anything_is_refused():
    class Hostile:
        def __array__(self, *_, **__):
            raise RuntimeError("boo")

    class Full:
        def __array__(self, *_, **__):
            raise MemoryError

    with pytest.raises(DataError, match="scan: a Hostile, expected"):
        PLACE_MAP.localize(Hostile())
    with pytest.raises(MemoryError):
        PLACE_MAP.localize(Full())


anything = st.recursive(
    st.none()
    | st.booleans()
    | st.floats()
    | st.integers()
    | st.text(max_size=3)
    | st.binary()
    | st.complex_numbers(),
    lambda inner: st.lists(inner, max_size=4) | st.tuples(inner, inner, inner),
    max_leaves=20,
)
any_array = arrays.arrays(
    arrays.scalar_dtypes() | arrays.array_dtypes(max_size=3),
    arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(values=anything | any_array)
def test_any_object_is_points_or_refused(values):
    """What is taken is finite, not (0, 0, 0), and the same numbers in the same order."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            points = scan_points("scan", values)
        except DataError:
            return
    assert points.dtype == np.float32
    assert points.ndim == 2
    assert points.shape[1] == 3
    assert np.isfinite(points).all()
    assert points.any(axis=1).all()
    rows = [[np.longdouble(value) for value in row[:3]] for row in real_array("", values)]
    with np.errstate(over="ignore"):
        expected = np.array(rows).astype(np.float32)
    expected = expected[np.isfinite(expected).all(axis=1) & expected.any(axis=1)]
    np.testing.assert_array_equal(points, expected)


GROWING = filled_map()


@settings(derandomize=True, max_examples=80, deadline=None)
@given(
    scans=anything | any_array | st.just([SCENE]) | st.just([SCENE, SCENE]),
    poses=anything | any_array | st.just(EYE) | st.just(POSES[:2]),
    names=anything | st.just(["a"]) | st.just(["a", "b"]),
)
def test_a_refused_addition_leaves_the_map_as_it_was(scans, poses, names):
    before = state_of(GROWING)
    try:
        GROWING.add(scans, poses, names)
    except DeepringError:
        assert state_of(GROWING) == before
    else:
        assert GROWING.localize(SCENE).fit == pytest.approx(KNOWN.fit)
    assert len(GROWING.index) == len(GROWING) == len(GROWING.places.names)


mirrored, scaled, sheared, projective = np.tile(np.eye(4), (4, 1, 1))
mirrored[2, 2], scaled[:3, :3], sheared[0, 1], projective[3, 0] = -1, 1.1 * np.eye(3), 0.1, 0.5


@pytest.mark.parametrize(
    ("scans", "poses", "names", "words"),
    [
        ([SCENE, SCENE], POSES[:2], "ab", "names: a str"),
        ([SCENE, SCENE], EYE, ["a", "b"], r"poses: shape \(1, 4, 4\), expected \(2, 4, 4\)"),
        ([SCENE], EYE[:, :3], ["a"], r"poses: shape \(1, 3, 4\)"),
        ([SCENE], EYE[0], ["a"], r"poses: shape \(4, 4\)"),
        ([SCENE], EYE * np.nan, ["a"], "poses: pose 0 is not finite"),
        ([SCENE], mirrored[None], ["a"], "poses: pose 0 is not rigid"),
        ([SCENE], scaled[None], ["a"], "pose 0 is not rigid"),
        ([SCENE], sheared[None], ["a"], "pose 0 is not rigid"),
        ([SCENE], projective[None], ["a"], "pose 0 is not rigid"),
        ([SCENE] * 3, np.concatenate([EYE, EYE, EYE * 0]), list("abc"), "pose 2 is not rigid"),
        ([SCENE], EYE + 0j, ["a"], "poses: an array of complex128"),
        ([SCENE], "east", ["a"], "poses: an array of <U4"),
        ([SCENE], None, ["a"], "poses: an array of object"),
        ([SCENE], EYE, ["a", "b"], "names: 2, expected 1"),
        ([SCENE], EYE, [], "names: 0, expected 1"),
        ([SCENE], EYE, [1], "names: a int, expected texts"),
        ([SCENE], EYE, None, "names: a NoneType"),
        (SCENE, np.tile(np.eye(4), (len(SCENE), 1, 1)), ["a"] * len(SCENE), r"scans\[0\]: shape"),
        (None, EYE, ["a"], "scans: a NoneType, expected a list of scans"),
        ("scans", EYE, ["a"], "scans: a str"),
        ([SCENE, SCENE[:0]], POSES[:2], ["a", "b"], r"scans\[1\]: no points"),
        ([SCENE, SCENE * 1000], POSES[:2], ["a", "b"], r"scans\[1\]: nothing stands out"),
    ],
)
def test_what_does_not_fit_together_is_named_before_anything_changes(scans, poses, names, words):
    place_map = filled_map()
    before = state_of(place_map)
    with pytest.raises(DataError, match=words):
        place_map.add(scans, poses, names)
    assert state_of(place_map) == before
    empty = Map(NETWORK)
    with pytest.raises(DataError, match=words):
        empty.add(scans, poses, names)
    assert (len(empty), len(empty.index), empty.index.shape, empty.index.code) == (0, 0, None, None)


def test_lists_generators_and_tensors_are_added_as_arrays(tmp_path):
    usual, other = filled_map(), Map(NETWORK)
    other.add(
        (scattered(k).tolist() for k in range(3)), torch.from_numpy(POSES), (n for n in "abc")
    )
    assert state_of(other) == state_of(usual)
    other.add([SCENE], [np.eye(4).tolist()], ["a"])  # names may repeat; places have numbers
    assert other.places.names == ["a", "b", "c", "a"]
    other.add([], np.empty((0, 4, 4)), [])
    assert len(other) == 4
    # A last row that is only nearly 0, 0, 0, 1 is made so: a map of it is opened again.
    nearly = EYE + 1e-9 * (np.arange(4) == 3)[:, None]
    other.add([SCENE], nearly, ["d"])
    other.save(tmp_path / "a.map")
    assert Map.open(tmp_path / "a.map", check=True).places.poses[-1].tolist()[3] == [0, 0, 0, 1]


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError, DataError("late")])
@pytest.mark.parametrize("where", ["encode", "places", "rows"])
@pytest.mark.parametrize("first", [True, False])
def test_an_addition_that_is_stopped_midway_leaves_places_and_index_in_step(
    error, where, first, monkeypatch
):
    place_map = Map(NETWORK) if first else filled_map()
    before = state_of(place_map)
    seen = place_map.observe([scattered(7), scattered(8)])
    whole = place_map.index.places.add

    def stop(*_):
        if where == "rows":
            whole(*_)  # and only then
        raise error

    with monkeypatch.context() as patch:
        if where == "encode":
            patch.setattr("deepring.search.correlation_index.encode", stop)
        elif where == "places":
            patch.setattr(place_map.index.places, "add", stop)
        else:
            patch.setattr(place_map.index.places, "add", stop)
        with pytest.raises(type(error) if isinstance(error, Exception) else error):
            place_map.add_observation(seen, POSES[:2], ["x", "y"])
    assert state_of(place_map) == before
    place_map.add_observation(seen, POSES[:2], ["x", "y"])
    assert len(place_map) == len(place_map.index) == (2 if first else 5)
    assert place_map.localize(scattered(8)).name == "y"


def observation(**changes):
    return PLACE_MAP.observe([SCENE])._replace(**changes)


SEEN = PLACE_MAP.observe([SCENE])


@pytest.mark.parametrize(
    ("seen", "words"),
    [
        (SEEN.images, "a ndarray, expected what Map.observe gives"),
        (tuple(SEEN), "a tuple, expected"),
        (SEEN._replace(images=SEEN.images.astype(np.uint8)), "expected bool arrays"),
        (SEEN._replace(images=torch.from_numpy(SEEN.images)), "images of a Tensor"),
        (SEEN._replace(images=SEEN.images[0]), r"images \(120, 120\), expected \(k, 120, 120\)"),
        (SEEN._replace(images=SEEN.images[:, 1:]), r"images \(1, 119, 120\)"),
        (SEEN._replace(images=np.zeros_like(SEEN.images)), "less than 10 occupied cells"),
        (SEEN._replace(descriptors=SEEN.descriptors[0]), "descriptors"),
        (SEEN._replace(descriptors=SEEN.descriptors[:, 1:]), r"expected \(1, 60, 31\)"),
        (SEEN._replace(descriptors=SEEN.descriptors.repeat(2, 1, 1)), r"\(2, 60, 31\), expected"),
        (SEEN._replace(descriptors=SEEN.descriptors * math.nan), "not finite"),
        (SEEN._replace(descriptors=SEEN.descriptors.numpy()), "expected as a tensor"),
        (SEEN._replace(descriptors=SEEN.descriptors + 0j), "expected as a tensor"),
    ],
)
def test_observations_are_those_of_a_map(seen, words):
    for place_map in (filled_map(), Map(NETWORK)):
        before = state_of(place_map)
        with pytest.raises(DataError, match=f"^observation: .*{words}"):
            place_map.add_observation(seen, EYE, ["a"])
        assert state_of(place_map) == before
    with pytest.raises(DataError, match=f"^observation: .*{words}"):
        PLACE_MAP.localize_observation(seen)


def test_one_scan_is_located_at_a_time():
    two = PLACE_MAP.observe([SCENE, scattered(1)])
    with pytest.raises(DataError, match="observation: 2 scans, expected one"):
        PLACE_MAP.localize_observation(two)
    none = Observation(two.images[:0], two.descriptors[:0])
    with pytest.raises(DataError, match="observation: 0 scans, expected one"):
        PLACE_MAP.localize_observation(none)


@pytest.mark.parametrize("before", [-1, 1.0, True, "1", math.nan])
def test_before_is_a_number_of_places(before):
    with pytest.raises(ConfigError, match=r"before: .*, expected a whole number of at least 0"):
        PLACE_MAP.localize(SCENE, before=before)
    with pytest.raises(DataError, match="no places to compare with"):
        PLACE_MAP.localize(SCENE, before=0)
    assert PLACE_MAP.localize(SCENE, before=99) == KNOWN


@pytest.mark.parametrize("ground_z", [math.nan, math.inf, "low", True, [0.0]])
def test_the_ground_is_a_number(ground_z):
    for refused in (
        lambda: Map(NETWORK, ground_z),
        lambda: PLACE_MAP.localize(SCENE, ground_z=ground_z),
        lambda: PLACE_MAP.observe([], ground_z),
        lambda: build_map(street(), NETWORK, 5.0, ground_z),
    ):
        with pytest.raises(ConfigError, match=r"ground_z: .*, expected a finite number"):
            refused()
    for far in (1e30, -1e300):
        with pytest.raises(BrokenScanError, match="nothing stands out"):
            PLACE_MAP.localize(SCENE, ground_z=far)


def street(n=4):
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = 10.0 * np.arange(n)
    files = tuple(Path(str(k)) for k in range(n))
    read = lambda path: scattered(int(path.name))  # noqa: E731
    return Session("street", files, poses, poses[:, :2, 3].copy(), None, read)


def test_settings_have_their_types():
    for name, value in {
        "network": (None, "net"),
        "search": ("int8", {}),
        "rerank": (25, "pose"),
        "thresholds": (0.2, (0.2, 1.4)),
    }.items():
        for wrong in value:
            with pytest.raises(ConfigError, match=rf"^{name}: a {type(wrong).__name__}, expected"):
                Map(**{"network": NETWORK, name: wrong})
    for spacing in (-1.0, math.nan, math.inf, "far"):
        with pytest.raises(ConfigError, match=r"spacing: .*, expected a number of metres"):
            build_map(street(), NETWORK, spacing)
        with pytest.raises(ConfigError, match=r"loops\.spacing"):
            LoopSettings(spacing)
    with pytest.raises(ConfigError, match="session: a list, expected a Session"):
        build_map([SCENE], NETWORK)
    with pytest.raises(ConfigError, match="session: a str"):
        find_loops("drive", Map(NETWORK))
    with pytest.raises(ConfigError, match="place_map: a DeepRing, expected a Map"):
        find_loops(street(), NETWORK)
    with pytest.raises(ConfigError, match="settings: a float"):
        find_loops(street(), Map(NETWORK), 2.0)
    with pytest.raises(ConfigError, match=r"loops\.refinement: a bool"):
        LoopSettings(refinement=True)
    assert find_loops(street(), Map(NETWORK)).scans.tolist() == [0, 1, 2, 3]


def test_a_search_for_loops_that_fails_leaves_its_map_empty():
    place_map, looked_at = Map(NETWORK), []

    def read(path):
        looked_at.append(len(place_map))
        if len(looked_at) == 4:
            raise KeyboardInterrupt
        return scattered(int(path.name))

    before = state_of(place_map)
    with pytest.raises(KeyboardInterrupt):
        find_loops(replace(street(), read=read), place_map)
    assert looked_at == [0, 1, 2, 3]
    assert state_of(place_map) == before
    assert find_loops(street(), place_map).scans.tolist() == [0, 1, 2, 3]


def test_a_map_lies_where_a_path_says(tmp_path):
    for path in (None, 5, b"a.map", "", ".", "a\0b", ["a.map"]):
        for use in (PLACE_MAP.save, Map.open):
            with pytest.raises(ConfigError, match=r"^path: .*, expected the path of a file"):
                use(path)
    with pytest.raises(FileError, match="cannot be written"):
        PLACE_MAP.save(tmp_path)
    for _ in range(2):  # it may be replaced
        PLACE_MAP.save(str(tmp_path / "a.map"))
    assert Map.open(tmp_path / "a.map").localize(SCENE) == KNOWN


def test_rotations_of_three_decimals_stay_poses_behind_a_sensor(tmp_path):
    """As a reader takes them from a file, and multiplies them by where the sensor sits."""
    rough = rotation_from_rpy(0.02, 0.01, np.linspace(0, 3, 9)).round(3)
    sensor = pose_from(rotation_from_rpy(0.3, 0.2, 1.0), np.ones(3))
    poses = pose_from(rough, np.zeros((9, 3))) @ sensor
    place_map = Map(NETWORK)
    place_map.add([SCENE] * 9, poses, ["a"] * 9)
    place_map.save(tmp_path / "a.map")
    np.testing.assert_array_equal(Map.open(tmp_path / "a.map").places.poses, poses)


def test_trials_have_rigid_poses():
    for pose, words in ((np.eye(3), r"shape \(1, 3, 3\)"), (scaled, "not rigid")):
        with pytest.raises(DataError, match=f"poses: .*{words}"):
            run_trials(PLACE_MAP, [(SCENE, pose)])
    with pytest.raises(DataError, match="holds no places"):
        run_trials(Map(NETWORK), [(SCENE, np.eye(4))])
    with pytest.raises(DataError, match="trials: none"):
        concatenate([])
    assert not run_trials(PLACE_MAP, []).trusted(AcceptanceThresholds()).any()
