"""Exported descriptors give the figures that the evaluation gave, and no others are scored."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from deepring.data.cache import RASTER_VERSION
from deepring.errors import DeepringError
from deepring.evaluation.descriptors import (
    file_name,
    read_descriptors,
    write_descriptors,
)
from deepring.evaluation.fingerprint import fingerprint
from deepring.evaluation.matches import COLUMNS
from deepring.evaluation.protocol import evaluate_method
from deepring.evaluation.reranked import evaluate_reranked
from deepring.evaluation.scoring import (
    Pair,
    find_pairs,
    score_descriptors,
    score_pair,
)
from deepring.localization.candidates import RerankSettings
from deepring.methods import registry
from deepring.methods.deepring import DeepRing
from deepring.methods.method import Comparison, rebuild_method
from deepring.methods.network import NetworkMethod
from deepring.methods.registry import register_method, registered_methods
from deepring.methods.ring import Ring
from deepring.methods.scan_context import ScanContext
from deepring.rasters import BevRaster, Preprocessing, raster_settings
from helpers.drives import PLACES, QUERIES, road_task
from helpers.tiny_methods import BEV, CONTEXT, TINY, deepring

METHODS = {
    **TINY,
    "Scan Context, 3 candidates": lambda: ScanContext(CONTEXT, candidates=3),
    "DeepRING by cosine": lambda: deepring(aggregation="gap", similarity="cosine"),
}


def test_every_registered_method_is_among_them():
    assert set(TINY) == set(registered_methods())


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """By label: the method, its task, what the evaluation gave, and the two sides it exported."""
    found = {}

    def export(label):
        if label not in found:
            method, folder = METHODS[label](), tmp_path_factory.mktemp("exported")
            task = road_task(method.raster)
            outcome = evaluate_method(task.case(label, "city"), method, task, export=folder)
            (pair,) = find_pairs(folder)
            sides = read_descriptors(pair.query), read_descriptors(pair.database)
            found[label] = method, task, outcome, pair, *sides
        return found[label]

    return export


#: Methods whose comparison has weights of its own.
BY_WEIGHTS = ("rinet", "overlapnet")


def assert_same(ours, theirs):
    """But for the seconds of a search, which are measured anew."""
    assert [replace(row, seconds_per_query=0) for row in ours.results] == [
        replace(row, seconds_per_query=0) for row in theirs.results
    ]
    assert ours.case == theirs.case
    for name in COLUMNS:
        values = getattr(theirs.matches, name)
        np.testing.assert_array_equal(getattr(ours.matches, name), values, err_msg=name)


@pytest.mark.parametrize("label", METHODS)
def test_the_outcome_is_that_of_the_evaluation(label, exported):
    method, _, outcome, pair, query, database = exported(label)
    row = outcome.results[0]
    assert (row.queries, row.database) == (QUERIES, PLACES)
    assert 0 < row.recall_1 < 1  # else equal figures would say little
    assert_same(score_descriptors(method, query, database), outcome)
    if label in BY_WEIGHTS:
        with pytest.raises(DeepringError, match="compares with its weights, which are not"):
            score_pair(pair)
        return
    assert_same(score_pair(pair), outcome)
    assert all(r.seconds_per_query > 0 for r in score_pair(pair).results)


@pytest.fixture(scope="module")
def seen_from_above():
    return road_task(BevRaster())


@pytest.mark.parametrize("label", TINY)
def test_the_candidates_of_every_method_are_aligned(label, exported, seen_from_above):
    _, _, outcome, *_ = exported(label)
    before = outcome.matches.place
    settings = RerankSettings(candidates=2)
    (aligned,) = evaluate_reranked(outcome, seen_from_above, ["pose"], settings)
    after = aligned.matches.place
    assert (np.sort(after[:, :2]) == np.sort(before[:, :2])).all()
    assert (after[:, 2:] == before[:, 2:]).all(), "behind them, the rest as it was"
    assert aligned.results[0].recall_1 >= outcome.results[0].recall_1


@pytest.mark.parametrize("label", ["ring", "deepring"])
def test_other_radii_give_what_an_evaluation_at_them_gives(label, exported):
    method, task, _, pair, query, _ = exported(label)
    radii = (3.0, 40.0, 12.5)
    outcome = evaluate_method(task.case(label, "city"), method, task, radii)
    rescored = score_pair(pair, radii)
    assert [row.radius_m for row in rescored.results] == [3.0, 40.0, 12.5]
    per_scan = query.seconds_per_scan
    rows = [replace(row, seconds_per_scan=per_scan) for row in outcome.results]
    assert_same(rescored, replace(outcome, results=rows))


def test_turned_queries_are_known_as_such(tmp_path):
    method = METHODS["ring"]()
    task = road_task(method.raster, turned=True)
    evaluate_method(task.case("RING"), method, task, export=tmp_path)
    (pair,) = find_pairs(tmp_path)
    assert np.array_equal(read_descriptors(pair.query).turns, task.scans.query.turns)
    assert read_descriptors(pair.database).turns is None


def test_progress_is_told(exported):
    method, _, _, _, query, database = exported("ring")
    told = []
    score_descriptors(method, query, database, progress=lambda *counts: told.append(counts))
    assert told == [(64, 70), (70, 70)]


def refuses(message, method, query, database, radii=(10.0,)):
    with pytest.raises(DeepringError, match=message):
        score_descriptors(method, query, database, radii)


def test_ring_against_scan_context_is_refused(exported):
    ring, *_, query, _ = exported("ring")
    *_, database = exported("scan_context")
    message = r"made_by\.method is 'ring' for the query and 'scan_context' for the database"
    refuses(message, ring, query, database)


def test_other_preprocessing_is_refused(exported):
    method, *_, query, database = exported("ring")
    low = BevRaster(cells=24, preprocessing=Preprocessing(height=(1.0, 20.0)))
    other = Ring(low, angles=24, bins=24)
    made = replace(database, made_by=fingerprint(other))
    height = r"raster\.preprocessing\.height is \[-5\.0, 20\.0\] for the query and \[1\.0, 20\.0"
    refuses(height, method, query, made)
    refuses(
        r"raster\.preprocessing\.height is \[1\.0, 20\.0\] for the method", other, query, database
    )


def test_other_weights_are_refused(exported):
    method, *_, query, database = exported("deepring")
    made = replace(database, made_by=fingerprint(deepring(seed=1)))
    refuses(r"weights is '\w{64}' for the query and '\w{64}' for", method, query, made)
    refuses(r"weights is '\w{64}' for the method", deepring(seed=1), query, database)


def test_rasters_of_two_versions_are_refused_together_but_each_is_scored(exported):
    method, _, outcome, _, query, database = exported("ring")
    made_by = {**query.made_by, "raster_version": 0}
    query = replace(query, made_by=made_by)
    words = f"raster_version is 0 for the query and {RASTER_VERSION} for"
    refuses(words, method, query, database)
    assert_same(score_descriptors(method, query, replace(database, made_by=made_by)), outcome)


def test_a_method_that_did_not_make_them_is_refused(exported):
    *_, query, database = exported("ring")
    refuses(
        "made_by.method is 'scan_context' for the method", ScanContext(CONTEXT), query, database
    )
    refuses("values.angles is 12 for the method and 24", Ring(BEV, 12, 24), query, database)


@pytest.mark.parametrize("key", ["test", "region", "method", "train"])
def test_sides_of_two_tests_are_refused(key, exported):
    ring, *_, query, database = exported("ring")
    other = replace(database, case=replace(database.case, **{key: "x"}))
    refuses(f"{key} is '.*' for the query and 'x'", ring, query, other)


def test_sides_in_the_wrong_place_and_of_other_shapes_are_refused(exported):
    ring, *_, query, database = exported("ring")
    refuses("the database in place of the query", ring, database, query)
    refuses("the query in place of the database", ring, query, query)
    narrow = replace(database, descriptors=database.descriptors[:, :, :5])
    refuses(r"shape is \[24, 13\] for the query and \[24, 5\]", ring, query, narrow)


def test_queries_without_an_answer_are_refused_with_the_nearest_place(exported):
    ring, *_, query, database = exported("ring")
    far = replace(query, positions=query.positions + np.array([0, 500]))
    message = r"road, region test: radius 10 m: 0 of 70 queries .* nearest lies at 500 m; .* wider"
    refuses(message, ring, far, database)
    assert score_descriptors(ring, far, database, (501.0,)).results[0].answerable > 0
    refuses("empty, expected at least one radius", ring, query, database, ())
    refuses("radius: -1.0, expected", ring, query, database, (10.0, -1.0))


def test_an_empty_database_is_refused(exported):
    *_, database = exported("ring")
    none = {name: array[:0] for name, array in database.arrays.items()}
    with pytest.raises(DeepringError, match="road, region test: the database holds 0 places"):
        replace(database, **none)


@pytest.mark.parametrize("label", METHODS)
def test_a_method_is_rebuilt_of_its_fingerprint_without_weights(label):
    made_by = fingerprint(METHODS[label]())
    rebuilt = rebuild_method(made_by)
    assert type(rebuilt) is type(METHODS[label]())
    assert fingerprint(rebuilt) == {
        key: value for key, value in made_by.items() if key != "weights"
    }
    if isinstance(rebuilt, NetworkMethod):
        assert all(weight.is_meta for weight in rebuilt.parameters())


class Untrained(Ring):
    """A user's method that is no network."""


class Learned(DeepRing):
    """A user's network, with weights in its comparison as well."""

    @torch.no_grad()
    def compare(self, queries, database):
        scores = super().compare(queries, database).score
        return Comparison(scores * next(self.parameters()).sum(), None)


class Bare:
    """A user's method that says nothing of how it is rebuilt."""

    raster = BEV

    def describe(self, rasters):
        return rasters.flatten(1).float()

    def compare(self, queries, database):
        return Comparison(queries @ database.T, None)


RING = fingerprint(Ring())


@pytest.mark.parametrize(
    ("made_by", "message"),
    [
        (fingerprint(Untrained()), r"'test_scoring\.Untrained' is not registered; expected one of"),
        ({**RING, "method": "subprocess.Popen"}, r"'subprocess\.Popen' is not registered"),
        (
            {"method": "nowhere.Net", "settings": {}},
            r"'nowhere\.Net' .*`own_class`",
        ),
        ({}, "'None' is not registered"),
        (
            {**RING, "values": {"angels": 60}},
            r"made_by\.values\.angels: unknown, expected one of angles",
        ),
        ({"method": "ring"}, "made_by.values: None, expected values by name: angles"),
        ({**RING, "raster": raster_settings(CONTEXT)}, "RING: raster: a ContextRaster, expected"),
        ({**fingerprint(deepring()), "settings": {"width": 3}}, r"DeepRING settings\.width: unk"),
    ],
)
def test_what_cannot_be_rebuilt_is_refused(made_by, message):
    with pytest.raises(DeepringError, match=message):
        rebuild_method(made_by)


def test_values_that_make_another_method_are_refused(exported, tmp_path):
    *_, pair, _, _ = exported("ring")
    assert score_pair(pair).results
    *_, query, database = exported("ring")
    raster = {k: v for k, v in query.made_by["raster"].items() if k != "extent"}
    made_by = {**query.made_by, "raster": {**raster, "size": 3}}
    with pytest.raises(DeepringError, match=r"raster\.size: unknown"):
        score_pair(written(tmp_path, query, database, made_by=made_by))
    made_by = {**query.made_by, "raster": raster}  # as a version without the field wrote it
    with pytest.raises(DeepringError, match=r"raster\.extent is 70\.0 for the method and None"):
        score_pair(written(tmp_path, query, database, made_by=made_by))


def written(folder, query, database, **changes):
    paths = []
    for side in (database, query):
        paths.append(folder / file_name(side.case, side.side))
        write_descriptors(paths[-1], replace(side, **changes))
    return Pair(*paths)


def test_a_network_that_compares_with_its_weights_needs_them(tmp_path):
    torch.manual_seed(0)
    method = Learned(deepring().settings)
    task = road_task(BEV)
    outcome = evaluate_method(task.case("mine"), method, task, export=tmp_path)
    (pair,) = find_pairs(tmp_path)
    with pytest.raises(DeepringError, match=r"'test_scoring\.Learned' is not registered"):
        score_pair(pair)
    with pytest.raises(DeepringError, match=r"Learned compares with its weights, .* not in the"):
        score_pair(pair, own_class=Learned)
    sides = read_descriptors(pair.query), read_descriptors(pair.database)
    assert_same(score_descriptors(method, *sides), outcome)


def test_a_method_of_a_user_is_scored_by_itself_or_with_its_class(tmp_path):
    method = Untrained(BEV, 24, 24)
    task = road_task(BEV)
    outcome = evaluate_method(task.case("mine"), method, task, export=tmp_path)
    (pair,) = find_pairs(tmp_path)
    sides = read_descriptors(pair.query), read_descriptors(pair.database)
    assert_same(score_descriptors(method, *sides), outcome)
    assert_same(score_pair(pair, own_class=Untrained), outcome)
    assert_same(score_pair(pair, own_class="test_scoring.Untrained"), outcome)
    with pytest.raises(DeepringError, match=r"the class given is deepring\.methods\.ring\.Ring"):
        score_pair(pair, own_class=Ring)


def test_a_method_that_cannot_be_rebuilt_is_refused():
    with pytest.raises(DeepringError, match=r"Bare' cannot be rebuilt, .* with from_fingerprint"):
        rebuild_method(fingerprint(Bare()), Bare)


def test_a_registered_method_of_a_user_is_rebuilt(monkeypatch):
    monkeypatch.setattr(registry, "_METHODS", dict(registry._METHODS))
    register_method("untrained", Untrained)
    made_by = fingerprint(Untrained(BEV, 24, 24))
    assert made_by["method"] == "untrained"
    assert type(rebuild_method(made_by)) is Untrained


def test_pairs_are_found_in_a_run_and_in_its_descriptors(exported, tmp_path):
    labels = ["ring", "deepring"]
    for label in labels:
        *_, query, database = exported(label)
        written(tmp_path / "descriptors", query, database)
    (tmp_path / "descriptors" / ".RING__road__test__query.safetensors.part").touch()
    (tmp_path / "descriptors" / "other.safetensors").touch()
    names = [(pair.database.name, pair.query.name) for pair in find_pairs(tmp_path / "descriptors")]
    assert names == [
        (f"{label}__road__test__database.safetensors", f"{label}__road__test__query.safetensors")
        for label in sorted(labels)
    ]
    assert find_pairs(tmp_path) == find_pairs(str(tmp_path / "descriptors"))


def test_folders_without_pairs_are_refused(exported, tmp_path):
    with pytest.raises(DeepringError, match="absent: no such folder"):
        find_pairs(tmp_path / "absent")
    with pytest.raises(DeepringError, match="no descriptor files in it"):
        find_pairs(tmp_path)
    *_, query, database = exported("ring")
    for lost in ("query", "database"):
        pair = written(tmp_path, query, database)
        getattr(pair, lost).unlink()
        with pytest.raises(DeepringError, match=f"__{lost}.safetensors: missing, but its other"):
            find_pairs(tmp_path)


def test_a_pair_that_does_not_belong_together_is_named_by_its_files(exported, tmp_path):
    *_, query, database = exported("ring")
    pair = written(
        tmp_path, replace(query, made_by={**query.made_by, "raster_version": 0}), database
    )
    files = (
        r"road__test__query\.safetensors and .*road__test__database\.safetensors: .*raster_version"
    )
    with pytest.raises(DeepringError, match=files):
        score_pair(pair)
