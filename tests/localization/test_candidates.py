"""Candidates aligned and chosen from: by distance without poses, by location with them."""

import math

import numpy as np
import pytest
import torch

from deepring.errors import DeepringError
from deepring.localization import candidates
from deepring.localization.alignment import Alignment, align, world_positions
from deepring.localization.alignment.image_correlation import half_whitened, occupied_cells
from deepring.localization.candidates import (
    RerankSettings,
    align_candidates,
    by_pose,
    spread_out,
)
from deepring.localization.location import best_fit
from deepring.rasters.bev import bev_occupancy
from helpers.scenes import scattered

SETTINGS = RerankSettings()


def street(seed=0, length=8):
    """Scenes side by side along x, 40 m apart, in one world: (n, 3) float32."""
    scenes = [scattered(seed + k, n=2000) + np.array([40.0 * k, 0, 0]) for k in range(length)]
    return np.concatenate(scenes).astype(np.float32)


def seen_from(world, x, y, heading):
    moved = world - np.array([x, y, 0], np.float32)
    c, s = math.cos(heading), math.sin(heading)
    turned = np.column_stack([moved @ [c, s, 0], moved @ [-s, c, 0], moved[:, 2]])
    return torch.from_numpy(bev_occupancy(turned.astype(np.float32)))


@pytest.fixture(scope="module")
def drive():
    """Map scans every 20 m with headings of their own, and a query 6 m beyond one of them."""
    world = street()
    poses = torch.tensor([[20.0 * k, 0.0, 0.3 * k] for k in range(2, 10)], dtype=torch.float64)
    maps = torch.stack([seen_from(world, *pose.tolist()) for pose in poses])
    at = (126.0, 3.0, 2.0)  # nearest: place 4, at x = 120
    turn = torch.tensor([float(pose[2]) - at[2] for pose in poses])
    return seen_from(world, *at), maps, poses, turn, at


def test_the_query_is_located_and_its_nearest_place_comes_first(drive):
    image, maps, poses, turn, at = drive
    shuffled = torch.tensor([7, 3, 5, 4, 1, 0, 2, 6])
    alignment = align_candidates(image, turn[shuffled], maps[shuffled], SETTINGS)
    best = best_fit(alignment, poses[shuffled], SETTINGS)
    assert np.hypot(*(best.position.numpy() - at[:2])) < 1.0
    assert best.fit == pytest.approx(float(alignment.score.max()))
    assert best.ratio > 1.3
    assert int(shuffled[by_pose(alignment, SETTINGS)[0]]) == 4
    # The misreading: map's turn taken for its opposite puts the query elsewhere.
    mirrored = poses[shuffled] * torch.tensor([1.0, 1.0, -1.0])
    wrong = best_fit(alignment, mirrored, SETTINGS)
    assert np.hypot(*(wrong.position.numpy() - at[:2])) > 2


def all_at_full_resolution(image, turn, maps):
    settings = SETTINGS.alignment
    both = torch.stack([turn, turn + math.pi], dim=1)
    cells = occupied_cells(image, settings)
    return align(cells, half_whitened(maps, settings), both, settings)


@pytest.mark.parametrize("x", [70.0, 126.0, 158.0])
@pytest.mark.parametrize("opposite", [0.0, math.pi])
def test_coarse_to_fine_names_what_the_full_resolution_of_all_names(drive, x, opposite):
    _, maps, poses, _, _ = drive
    at = (x, -2.0, 0.9)
    image = seen_from(street(), *at)
    turn = (poses[:, 2] - at[2] + opposite).float()
    ours = align_candidates(image, turn, maps, SETTINGS, poses)
    full = all_at_full_resolution(image, turn, maps)
    best, reference = best_fit(ours, poses, SETTINGS), best_fit(full, poses, SETTINGS)
    assert best.candidate == reference.candidate
    assert best.fit == pytest.approx(reference.fit, rel=1e-3)
    assert best.ratio == pytest.approx(reference.ratio, rel=0.05)
    torch.testing.assert_close(best.position, reference.position, atol=0.05, rtol=0)
    assert ours.turn[best.candidate] == pytest.approx(float(full.turn[best.candidate]), abs=2e-3)
    without = align_candidates(image, turn, maps, SETTINGS)
    assert by_pose(without, SETTINGS)[0] == by_pose(full, SETTINGS)[0]


def test_estimates_never_exceed_what_the_full_resolution_gives(drive):
    image, maps, poses, turn, _ = drive
    many = maps.repeat(4, 1, 1)
    many[8:] = many[8:].flip(1)  # mirrored: they fit nowhere
    ours = align_candidates(image, turn.repeat(4), many, SETTINGS, poses.repeat(4, 1))
    full = all_at_full_resolution(image, turn.repeat(4), many)
    exact = (ours.score - full.score).abs() < 1e-3
    assert 5 <= int(exact.sum()) < 32  # some are estimated
    assert ours.score[~exact].max() <= ours.score[exact].min() + 1e-6
    assert int(ours.score.argmax()) == int(full.score.argmax())


def test_where_nothing_fits_few_are_aligned_at_the_full_resolution(drive, monkeypatch):
    image, maps, poses, turn, _ = drive
    rows = []
    monkeypatch.setattr(
        candidates, "align", lambda *args: rows.append(len(args[1])) or align(*args)
    )
    mirrored, apart = maps.flip(1).repeat(4, 1, 1), poses.repeat(4, 1)
    apart[:, 0] += 400.0 * torch.arange(32)
    align_candidates(image, turn.repeat(4), mirrored, SETTINGS, apart)
    align_candidates(image, turn.repeat(4), mirrored, SETTINGS)
    assert rows[0] <= 8 + 3 < rows[1]


def test_without_yaws_the_whole_turn_is_tried(drive):
    image, maps, _, turn, _ = drive
    some = torch.tensor([3, 4])
    alignment = align_candidates(image, None, maps[some], SETTINGS)
    known = align_candidates(image, turn[some], maps[some], SETTINGS)
    apart = torch.remainder(alignment.turn - known.turn + 3, 2 * math.pi) - 3
    assert apart.abs().max() < math.radians(2)
    assert torch.allclose(alignment.position, known.position, atol=0.7)


def made_up(score, positions):
    n = len(score)
    return Alignment(torch.tensor(score), torch.zeros(n), torch.tensor(positions))


def test_of_candidates_that_fit_the_nearest_is_taken():
    alignment = made_up([0.9, 0.7, 0.3, 0.5], [[9.0, 9.0], [3.0, 4.0], [0.0, 0.0], [1.0, 0.0]])
    # 0.3 and 0.5 lie below 0.65 of the best; alone the fit decides among them.
    assert by_pose(alignment, SETTINGS).tolist() == [1, 0, 3, 2]


def test_the_ratio_counts_rivals_that_contradict_alone():
    poses = torch.tensor([[0.0, 0.0, 0.0], [20.0, 0.0, math.pi / 2], [90.0, 0.0, 0.0]])
    alignment = made_up([0.6, 0.5, 0.3], [[10.0, 5.0], [5.0, 10.0], [0.0, 0.0]])
    best = best_fit(alignment, poses, SETTINGS)
    assert torch.allclose(
        world_positions(alignment.position, poses)[1].float(), torch.tensor([10.0, 5.0])
    )
    assert best.candidate == 0
    assert best.ratio == pytest.approx(2.0)
    alone = best_fit(made_up([0.6], [[1.0, 2.0]]), poses[:1], SETTINGS)
    assert alone.ratio == math.inf


def test_mistakes_are_named():
    with pytest.raises(DeepringError, match=r"rerank\.candidates: 0"):
        RerankSettings(candidates=0)
    for name, value in {"close": 0, "apart": 0.0, "spread": -1.0}.items():
        with pytest.raises(DeepringError, match=rf"rerank\.{name}: {value}"):
            RerankSettings(**{name: value})


def test_candidates_of_a_dense_map_lie_apart():
    rng = torch.Generator().manual_seed(0)
    positions = torch.rand(200, 2, generator=rng, dtype=torch.float64) * 40
    taken = spread_out(positions, RerankSettings(candidates=12, spread=5.0))
    assert len(taken) == 12
    assert taken[0] == 0
    assert (taken.diff() > 0).all()  # better ones first
    chosen = positions[taken]
    assert (torch.cdist(chosen, chosen) + 99 * torch.eye(12) >= 5.0).all()
    # Whatever was passed over lies close to a better one that was taken.
    for k in set(range(int(taken[-1]))) - set(taken.tolist()):
        better = chosen[taken < k]
        assert torch.linalg.vector_norm(better - positions[k], dim=1).min() < 5.0


def test_without_a_spread_the_best_are_taken_and_a_short_list_is_no_error():
    positions = torch.zeros(30, 2)
    assert spread_out(positions, RerankSettings(candidates=7, spread=0.0)).tolist() == [*range(7)]
    assert spread_out(positions, RerankSettings(candidates=7)).tolist() == [0]
