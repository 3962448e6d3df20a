"""The case study: what a known motion leaves in the magnitudes of SG and PG."""

import csv
import math
from dataclasses import astuple

import numpy as np
import pytest
import torch

from deepring.core.equivariance import relative_error
from deepring.errors import DeepringError
from deepring.paper.case_study import (
    DRAWN,
    KERNELS,
    NAMES,
    ROTATIONS_DEG,
    ROWS,
    TRANSLATIONS_M,
    Extractor,
    case_pair,
    measure,
    undo_turn,
    write_errors,
)
from deepring.paper.moved_scans import UNRELATED_M, Motion
from helpers.scenes import scattered

STEP = 360 / ROWS
GROUND = 0.0


def scan(seed):
    """Walls over a flat floor, so that ground removal finds its floor everywhere."""
    floor = np.mgrid[-70:70:1.0, -70:70:1.0].reshape(2, -1).T
    flat = np.column_stack([floor, np.zeros(len(floor))]).astype(np.float32)
    return np.concatenate([scattered(seed), flat])


def pair_error(name, points, motion, undone):
    """Relative error with the rows rolled back by ``undone`` degrees."""
    extractor = Extractor(name)
    a, b = extractor.magnitude(extractor.rasters([points, motion(points)], GROUND))
    return relative_error(undo_turn(b, undone), a)


def rows_of(rows, name, kind):
    return {row.value: row for row in rows if (row.representation, row.kind) == (name, kind)}


@pytest.fixture(scope="module")
def measured():
    scans = [(scan(seed), np.array([1000.0 * seed, 0.0])) for seed in range(4)]
    return measure(scans, GROUND, pairs=4)


@pytest.mark.parametrize("name", NAMES)
def test_no_motion_gives_no_error(name):
    assert pair_error(name, scan(0), Motion(0.0), 0.0) == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_a_quarter_turn_maps_both_grids_onto_themselves(name):
    assert pair_error(name, scan(0), Motion(90.0), 90.0) < 0.01


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("rows", [1, 7, 50])
def test_a_turn_is_undone_by_rolling_back_and_not_by_rolling_on(name, rows):
    turn = rows * STEP
    undone = pair_error(name, scan(0), Motion(turn), turn)
    assert undone < 0.13, "what the quantisation leaves"
    wrong = pair_error(name, scan(0), Motion(turn), -turn)
    assert wrong > 2 * undone, "the usual misreading of the direction"


def test_a_translation_leaves_sg_and_destroys_pg_and_ri():
    motion = Motion(0.0, (6.0, -8.0))
    sg, pg, ri = (pair_error(name, scan(0), motion, 0.0) for name in NAMES)
    assert sg < 0.15
    assert min(pg, ri) > 3 * sg


def test_a_motion_turns_first_and_then_shifts():
    point = np.array([[1.0, 0.0, 0.5]], np.float32)
    moved = Motion(90.0, (10.0, 0.0))(point)
    np.testing.assert_allclose(moved, [[10.0, 1.0, 0.5]], atol=1e-6)
    assert point[0, 0] == 1.0, "the scan itself stays"


def test_all_representations_see_the_same_layer_and_the_callers_seed_is_left_alone():
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    weights = [Extractor(name, seed).layer.conv.weight for name in NAMES for seed in (0, 1)]
    assert torch.equal(torch.rand(3), expected)
    assert torch.equal(weights[0], weights[2])
    assert not torch.equal(weights[0], weights[1])


def test_the_images_of_a_pair_have_the_norms_of_its_error():
    pair = case_pair(scan(0), Motion(33.0, (5.0, 0.0)), GROUND)
    assert pair.bevs.shape == (2, 120, 120)
    assert tuple(view.name for view in pair.views) == DRAWN
    for view in pair.views:
        assert view.images.shape == (2, ROWS, 120)
        assert view.magnitudes.shape == (2, ROWS, 61)
        norms = np.linalg.norm(view.difference), np.linalg.norm(view.magnitudes[0])
        assert norms[0] / norms[1] == pytest.approx(view.error, rel=1e-4)
        extractor = Extractor(view.name)
        raster = extractor.rasters([scan(0)], GROUND)
        assert extractor.magnitude(raster).shape == (1, KERNELS, ROWS, 61)


def test_every_motion_has_a_row_and_the_first_of_each_kind_is_zero(measured):
    for name in NAMES:
        shifts, turns = rows_of(measured, name, "translation"), rows_of(measured, name, "rotation")
        assert tuple(shifts) == TRANSLATIONS_M
        assert tuple(turns) == ROTATIONS_DEG
        assert shifts[0.0].mean == turns[0.0].mean == 0.0
        assert all(row.n == 4 and row.q25 <= row.median <= row.q75 for row in shifts.values())


def test_half_of_the_turns_end_between_two_rows():
    whole = [(turn / STEP).is_integer() for turn in ROTATIONS_DEG]
    assert whole == [k % 2 == 0 for k in range(len(ROTATIONS_DEG))]


def test_sg_stays_far_from_unrelated_scans_where_pg_reaches_them(measured):
    share = {}
    for name in NAMES:
        unrelated = rows_of(measured, name, "unrelated")[None].mean
        share[name] = rows_of(measured, name, "translation")[10.0].mean / unrelated
    assert share["SG"] < 0.5 < 0.8 < share["PG"]


def test_a_turn_between_two_rows_costs_pg_far_more_than_a_whole_row(measured):
    turns = {name: rows_of(measured, name, "rotation") for name in NAMES}
    assert turns["PG"][52.5].mean > 2 * turns["PG"][45.0].mean
    assert turns["SG"][52.5].mean < 0.15


def test_unrelated_means_far_apart_or_another_file():
    def kinds(*positions):
        scans = [(scan(k), p and np.array(p)) for k, p in enumerate(positions)]
        return {row.kind for row in measure(scans, GROUND, pairs=2)}

    near, far = (0.0, UNRELATED_M - 1), (0.0, UNRELATED_M + 1)
    assert "unrelated" not in kinds((0.0, 0.0), near)
    assert "unrelated" in kinds((0.0, 0.0), far)
    assert "unrelated" in kinds(None, None)
    assert "unrelated" not in kinds(None)


def test_the_same_place_turned_is_aligned_before_it_counts_as_unrelated():
    points = scan(0)
    twice = [(points, None), (Motion(90.0)(points), None)]
    rows = measure(twice, GROUND, pairs=2)
    assert rows_of(rows, "SG", "unrelated")[None].mean < 0.15


def test_few_scans_are_repeated_from_other_headings_and_no_more_are_read():
    read = []

    def scans():
        for k in range(5):
            read.append(k)
            yield scan(k), None

    rows = measure(scans(), GROUND, pairs=3, repeats=2)
    assert read == [0, 1]
    assert {row.n for row in rows} == {3}
    repeated = rows_of(measure([(scan(0), None)], GROUND, 2, 2), "SG", "rotation")
    assert repeated[45.0].q25 < repeated[45.0].q75, "another heading, another error"


def test_the_same_seed_gives_the_same_file_and_another_seed_another(tmp_path):
    files = []
    for number, seed in enumerate((3, 3, 4)):
        files.append(tmp_path / f"{number}.csv")
        write_errors(files[-1], measure([(scan(0), None)], GROUND, pairs=1, seed=seed))
    same, again, other = (file.read_bytes() for file in files)
    assert same == again != other


def test_the_file_is_long_and_reads_back(tmp_path, measured):
    write_errors(tmp_path / "new" / "errors.csv", measured)
    with (tmp_path / "new" / "errors.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(measured) == 3 * (len(TRANSLATIONS_M) + len(ROTATIONS_DEG) + 1)
    assert ",".join(rows[0]) == "representation,kind,value,unit,n,mean,median,q25,q75"
    assert [row["value"] for row in rows if row["kind"] == "unrelated"] == ["", "", ""]
    for row, (*_, n, mean, _median, _q25, q75) in zip(rows, map(astuple, measured), strict=True):
        assert int(row["n"]) == n
        assert math.isclose(float(row["mean"]), mean, rel_tol=1e-5)
        assert math.isclose(float(row["q75"]), q75, rel_tol=1e-5)


def test_nothing_to_measure_is_an_error():
    with pytest.raises(DeepringError, match="scans"):
        measure([], GROUND)
    with pytest.raises(DeepringError, match="pairs: 0"):
        measure([(scan(0), None)], GROUND, pairs=0)
