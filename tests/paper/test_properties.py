"""What a method bears, tells and costs, where the answer is known."""

import math

import numpy as np
import pytest
import torch

from deepring.errors import DataError
from deepring.methods.fast_histogram import FastHistogram
from deepring.methods.m2dp import M2dp
from deepring.methods.method import Comparison
from deepring.methods.ring import Ring
from deepring.methods.scan_context import ScanContext
from deepring.methods.scan_context_plus_plus import CartContext
from deepring.methods.ssc import Ssc
from deepring.paper.method_curves import curves_figure, method_rows
from deepring.paper.moved_scans import Motion, Place, Scan, moved_scores
from deepring.paper.properties import EXACT, properties_of, sector_of
from deepring.paper.properties_tables import number_table, shown_tables
from deepring.rasters import (
    BevRaster,
    CartContextRaster,
    ContextRaster,
    M2dpRaster,
    Preprocessing,
    SemanticPointsRaster,
)
from deepring.testing import walls, with_columns
from helpers.tiny_methods import TINY

#: Everything from the ground up, so that no square grid takes part in what a turn changes.
WHOLE = Preprocessing(height=(-1.0, 100.0), clearance=None, extent=80.0)


@pytest.fixture(scope="module")
def scans():
    return [Scan(walls(k), Place(k, np.array([1000.0 * k, 0.0]))) for k in range(5)]


def measured(method, scans, **options):
    return properties_of("m", method, scans, 0.0, **options)


def test_a_histogram_of_ranges_bears_every_turn_and_no_shift(scans):
    found = measured(FastHistogram(), scans)
    assert max(map(abs, (found.any_turn, found.half_turn))) <= EXACT
    assert found.sectors == 0.0
    assert found.same
    assert 0.01 < found.shifts[0] < found.shifts[2]
    assert (found.numbers, found.bytes) == (100, 400)
    assert found.turn_error_deg is found.pose_error is None
    assert found.parameters == 0
    assert found.scan_ms > 0 < found.pair_ms


def test_ring_bears_a_quarter_turn_and_nearly_any_and_tells_it(scans):
    ring = Ring(BevRaster(preprocessing=WHOLE))
    found = measured(ring, scans)
    assert (found.sector_deg, found.same) == (90.0, False)
    assert abs(found.sectors) <= 0.02, "a quarter turn maps the grid onto itself"
    assert found.sectors < found.any_turn < 0.4
    assert found.shifts[0] < 0.3
    assert found.turn_error_deg < 3.0
    assert found.turn_period_deg == pytest.approx(math.degrees(ring.turn_period))


def test_scan_context_bears_its_sectors_exactly_and_half_sectors_not(scans):
    context = ScanContext(ContextRaster(preprocessing=WHOLE))
    found = measured(context, scans)
    assert (found.sector_deg, found.same) == (6.0, False)
    assert abs(found.sectors) <= EXACT < 0.01 < found.any_turn
    assert found.half_turn <= 0.01, "30 sectors"
    half_sector = [(Motion(0.0), [Motion(3.0)])] * len(scans)
    assert moved_scores(context, scans, half_sector, 0.0).lost.mean() > 0.05


def test_m2dp_fails_at_half_a_turn_unless_it_has_every_sign(scans):
    published, signs = (measured(M2dp(M2dpRaster(signs=n)), scans[:2]) for n in (1, 4))
    assert published.half_turn > 0.5
    assert signs.half_turn <= 0.01


def test_a_cartesian_context_bears_the_way_back_with_its_copy_alone(scans):
    one, both = (measured(CartContext(CartContextRaster(reverse=r)), scans) for r in (False, True))
    assert one.half_turn > 0.3 > 0.05 > both.half_turn


def test_ssc_tells_a_pose_from_labels(scans):
    labelled = [scan._replace(points=with_columns(scan.points, ["label"])) for scan in scans[:2]]
    method = Ssc(SemanticPointsRaster(count=1000))
    found = measured(method, labelled, columns=["label"])
    assert found.turn_error_deg < 2.0
    metres, degrees = found.pose_error
    assert metres < 1.5, "no offset is 2 m off, one of the wrong sign 4 m"
    assert degrees < 15.0, "random walls turn the landmarks of two places 2 m apart"
    with pytest.raises(DataError, match="no labels"):
        measured(method, scans)


class Known:
    """Tells the pose that it reads off two marked points, or one that is wrong."""

    def __init__(self, wrong_m=0.0):
        self.raster = BevRaster(cells=24, preprocessing=WHOLE)
        self.wrong_m, self.answers = wrong_m, None

    def describe(self, rasters):
        return rasters.float().flatten(1)

    def compare(self, queries, database):
        return Comparison(-torch.cdist(queries, database), None)

    def relative_poses(self, _query, _places):
        turn, x, y = self.answers.pop(0)
        pose = np.eye(4)
        pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        pose[:2, 3] = x + self.wrong_m, y
        return torch.from_numpy(pose)[None]


@pytest.mark.parametrize("wrong", [0.0, 0.7])
def test_the_error_of_a_pose_is_that_of_the_places_points_on_the_querys(wrong, scans, monkeypatch):
    method, asked = Known(wrong), []
    call = Motion.__call__
    monkeypatch.setattr(Motion, "__call__", lambda self, p: asked.append(self) or call(self, p))
    method.answers = _Told(asked)
    assert measured(method, scans).pose_error == (pytest.approx(wrong, abs=1e-9), pytest.approx(0))


class _Told:
    """The pose between the last two motions: the scan's, then its twin's."""

    def __init__(self, asked):
        self.asked = asked

    def pop(self, _):
        still, twin = self.asked[-2:]
        return np.radians(twin.yaw_deg - still.yaw_deg), *twin.shift


def test_a_pose_that_is_never_told_has_no_error(scans):
    class Silent(Known):
        def relative_poses(self, _query, places):
            return torch.full((len(places), 4, 4), torch.nan, dtype=torch.float64)

    found = measured(Silent(), scans)
    assert all(map(math.isnan, found.pose_error))
    assert shown_tables([found], "", [])["properties_told"].rows[0][3].text == "-"


def test_a_method_that_cannot_tell_places_apart_loses_nothing_that_could_be_told(scans):
    class Same(Known):
        def compare(self, queries, database):
            return Comparison(torch.zeros(len(queries), len(database)), None)

        relative_poses = None

    found = measured(Same(), scans)
    assert math.isnan(found.any_turn)
    assert {row[4].text for row in shown_tables([found], "", [])["properties_borne"].rows} == {"-"}


def test_scans_of_one_place_are_refused(scans):
    with pytest.raises(DataError, match="all of one place"):
        measured(FastHistogram(), scans[:1])
    near = [scan._replace(place=Place(k, np.zeros(2))) for k, scan in enumerate(scans)]
    with pytest.raises(DataError, match="farther apart than 140 m"):
        measured(FastHistogram(), near)


def test_the_same_seed_gives_the_same_numbers_but_for_times(scans):
    def numbers(seed):
        row = number_table([measured(TINY["locnet"](), scans[:3], seed=seed)]).rows[0]
        return [cell.text for cell in row][:-2]

    assert numbers(1) == numbers(1) != numbers(2)


def test_parameters_are_the_networks(scans):
    network = TINY["locnet"]()
    found = measured(network, scans[:3])
    assert found.parameters == sum(p.numel() for p in network.parameters())


def test_the_step_of_a_raster_is_its_sectors():
    steps = {name: sector_of(make()) for name, make in TINY.items()}
    assert steps["lidar_iris"] == 5.0
    assert steps["egonn"] == 6.0
    assert steps["ring"] == steps["ring_plus_plus"] == steps["deepring"] == 90.0
    assert steps["m2dp"] is steps["cart_context"] is None


def test_tables_say_what_is_exact_and_the_csv_has_every_number(scans):
    rows = [measured(FastHistogram(), scans), measured(Ring(BevRaster(cells=24)), scans)]
    borne, told, cost = shown_tables(rows, ": here", ["a note"]).values()
    cells = [[cell.text for cell in row] for row in borne.rows]
    assert cells[0][:6] == ["m", "same", "exact", "1°", "exact", "exact"]
    assert "here" in borne.title
    assert "a note" in borne.notes
    assert [cell.text for cell in told.rows[0]] == ["m", "-", "-", "-"]
    assert [cell.text for cell in cost.rows[0]][:4] == ["m", "100", "400", "-"]
    numbers = number_table(rows)
    assert len(numbers.headers) == len(set(numbers.headers)) == len(numbers.rows[0])
    whole = dict(zip(numbers.headers, numbers.rows[1], strict=True))
    assert float(whole["loss_5_m"].text) == rows[1].shifts[1]
    assert whole["pose_error_m"].text == ""


def test_curves_begin_at_nothing_lost_and_end_at_another_place(scans):
    rows = method_rows("Fast Histogram", FastHistogram(), scans[:3], 0.0)
    mean = {(row.kind, row.value): row.mean for row in rows}
    assert mean["translation", 0.0] == pytest.approx(0.0, abs=1e-6)
    assert mean["unrelated", None] == pytest.approx(1.0)
    assert max(mean["rotation", turn] for turn in (45.0, 97.5, 180.0)) < EXACT
    assert mean["translation", 20.0] > mean["translation", 1.0] > 0.01
    figure = curves_figure(rows, "a place")
    shifted, turned = figure.axes
    assert len(shifted.lines[0].get_xdata()) == 21
    assert figure.get_suptitle() == "a place"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["Fast Histogram"]
    assert turned.lines[0].get_xdata()[-1] == 180.0


@pytest.mark.parametrize("name", TINY)
def test_every_method_is_measured(name, scans):
    method = TINY[name]()
    names = getattr(method.raster, "columns", ())
    points = [scan._replace(points=with_columns(scan.points, names)) for scan in scans[:2]]
    found = measured(method, points, columns=names)
    assert found.bytes >= found.numbers > 0
    assert found.scan_ms > 0 < found.pair_ms
    assert found.turn_period_deg in (180.0, 360.0)
