"""Targets by distance: distributions, their limits, and losses against loops."""

import math

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from torch import nn

from deepring.core.correlation import circular_cross_correlation, unit_norm
from deepring.errors import ConfigError
from deepring.methods.deepring import DeepRing
from deepring.training.episodes import (
    EpisodeScheme,
    GradedCrossEntropy,
    OneShotCrossEntropy,
    SmoothAp,
    Triplet,
    class_scores,
    graded_targets,
)
from deepring.training.module import PlaceModule
from deepring.training.training_scans import TrainingScans
from helpers.networks import deepring_settings
from helpers.training_scans import some_scans

QUERIES, WAYS = 5, 4


def score(queries, database):
    return circular_cross_correlation(queries, database).score


def some_episode(shots=2, seed=0):
    """Descriptors of queries (5, 6, 5) and shots (4, shots, 6, 5), and their distances."""
    generator = torch.Generator().manual_seed(seed)
    queries = unit_norm(torch.randn(QUERIES, 6, 5, generator=generator))
    support = unit_norm(torch.randn(WAYS, shots, 6, 5, generator=generator))
    return queries, support, 30 * torch.rand(QUERIES, WAYS, shots, generator=generator)


def test_targets_are_distributions_that_favour_the_nearer_way():
    _, _, distances = some_episode()
    targets = GradedCrossEntropy(scale=8.0).targets(distances)
    nearest = distances.amin(dim=2)
    assert targets.shape == (QUERIES, WAYS)
    assert torch.allclose(targets.sum(dim=1), torch.ones(QUERIES))
    assert torch.equal(targets.argsort(dim=1, descending=True), nearest.argsort(dim=1))


def test_shares_are_the_softmax_of_squared_distances_over_the_scale():
    distances = [[3.0, 12.0, 20.0], [9.0, 9.0, 1e6]]
    for row, found in zip(distances, graded_targets(torch.tensor(distances), 7.0), strict=True):
        weights = [math.exp(-((d / 7.0) ** 2)) for d in row]
        assert found.tolist() == pytest.approx([w / sum(weights) for w in weights], rel=1e-5)


def test_targets_of_half_precision_distances_are_finite():
    for dtype in (torch.float16, torch.bfloat16):
        targets = graded_targets(torch.tensor([[4.0, 22.0, 1e6]]).to(dtype), 10.0)
        assert targets.tolist()[0] == pytest.approx([0.991, 0.009, 0.0], abs=1e-3)


def test_between_two_ways_equally_near_the_target_is_one_half_and_not_one_way():
    targets = GradedCrossEntropy().targets(torch.tensor([[[6.0], [6.0], [90.0]]]))
    assert targets.tolist()[0] == pytest.approx([0.5, 0.5, 0.0])


def test_a_small_scale_leaves_the_one_shot_loss():
    queries, support, _ = some_episode()
    own = torch.tensor([0, 1, 2, 3, 0])
    distances = torch.full((QUERIES, WAYS, 2), 25.0)
    distances[torch.arange(QUERIES), own] = 4.0
    graded, one_hot = GradedCrossEntropy(20.0, scale=1.0), OneShotCrossEntropy(20.0)
    found = graded(queries, support, graded.targets(distances), score)
    expected = one_hot(queries, support, own, score)
    assert found.loss.item() == pytest.approx(expected.loss.item(), rel=1e-5)
    assert found.accuracy == expected.accuracy
    assert found.parts["entropy"].item() == pytest.approx(0, abs=1e-6)
    assert found.parts["W"].item() == 20.0


def test_the_loss_is_the_cross_entropy_with_the_shares_and_never_below_their_entropy():
    queries, support, distances = some_episode()
    loss = GradedCrossEntropy(20.0)
    targets = loss.targets(distances)
    step = loss(queries, support, targets, score)
    expected = F.cross_entropy(20.0 * class_scores(queries, support, score), targets)
    assert step.loss.item() == pytest.approx(expected.item(), rel=1e-5)
    # A network that says exactly the shares has the entropy as its loss.
    perfect = loss(queries, support, targets, lambda *_: targets.log().repeat_interleave(2, 1) / 20)
    assert perfect.loss.item() == pytest.approx(step.parts["entropy"].item(), rel=1e-4)
    assert step.loss > step.parts["entropy"]


def average_precision(scores, relevant):
    """By the ranks of the relevant ways."""
    order = sorted(range(len(scores)), key=lambda k: -scores[k])
    ranks = [rank for rank, k in enumerate(order, 1) if relevant[k]]
    return sum(found / rank for found, rank in enumerate(ranks, 1)) / len(ranks)


def test_smooth_ap_tends_to_the_average_precision():
    queries, support, distances = some_episode(seed=1)
    distances[3] = 40.0  # without a relevant way, it does not count
    loss = SmoothAp(radius=10.0, temperature=1e-5)
    targets = loss.targets(distances)
    scores = class_scores(queries, support, score)
    usable = [q for q in range(QUERIES) if targets[q].any()]
    assert len(usable) == QUERIES - 1
    expected = [average_precision(scores[q].tolist(), targets[q].tolist()) for q in usable]
    step = loss(queries, support, targets, score)
    assert step.loss.item() == pytest.approx(1 - np.mean(expected), abs=1e-4)
    first = [targets[q, scores[q].argmax()].item() for q in usable]
    assert step.accuracy.item() == pytest.approx(np.mean(first))


def test_smooth_ap_of_no_relevant_way_at_all_is_zero_and_has_a_gradient():
    queries, support, _ = some_episode()
    queries.requires_grad_()
    loss = SmoothAp()
    step = loss(queries, support, loss.targets(torch.full((QUERIES, WAYS, 2), 50.0)), score)
    step.loss.backward()
    assert step.loss.item() == 0
    assert queries.grad.abs().max() == 0


@pytest.mark.parametrize("loss", [GradedCrossEntropy(10.0), SmoothAp(15.0, temperature=0.1)])
def test_a_step_along_the_gradient_lowers_each_loss(loss):
    queries, support, distances = some_episode(seed=2)
    queries.requires_grad_()
    targets = loss.targets(distances)
    before = loss(queries, support, targets, score).loss
    (gradient,) = torch.autograd.grad(before, queries)
    assert gradient.abs().max() > 0
    after = loss(queries - 1e-3 * gradient / gradient.norm(), support, targets, score).loss
    assert after < before


def test_wrong_arguments_are_named():
    with pytest.raises(ConfigError, match=r"loss\.scale: 0"):
        GradedCrossEntropy(scale=0)
    with pytest.raises(ConfigError, match=r"loss\.radius: -1"):
        SmoothAp(radius=-1)
    with pytest.raises(ConfigError, match=r"loss\.temperature: 0"):
        SmoothAp(temperature=0)


def street():
    """Scans every 2 m along 400 m, out and back."""
    line = np.arange(0.0, 400.0, 2.0)
    return np.column_stack([np.r_[line, line[::-1]], np.zeros(400)])


@pytest.mark.parametrize("shots", [1, 2])
def test_overlapping_ways_keep_their_shots_apart_and_their_scans_together(shots):
    positions = street()
    scheme = EpisodeScheme(8, shots, 3, negative_radius=9.0, neighbours=1.0, overlapping=True)
    zeros = np.zeros(400, dtype=np.int64)
    scans = TrainingScans(positions, zeros, np.zeros(400), some_scans(100, 4).rasters, zeros)
    episodes = scheme.training_set(scans, seed=0)
    shared = 0
    for index in range(4):
        rows = episodes.places.sample(np.random.default_rng([0, index]))
        assert len(set(rows.ravel())) == rows.size == 8 * (shots + 3)
        for row in rows:
            apart = np.linalg.norm(positions[row][:, None] - positions[row][None], axis=-1)
            assert apart.max() <= 10
        support = positions[rows[:, :shots]]
        apart = np.linalg.norm(support[:, None, :, None] - support[None, :, None], axis=-1)
        other = ~np.eye(8, dtype=bool)
        assert apart[other].min() > 9
        queries = positions[rows[:, shots:].ravel()]
        distances = np.linalg.norm(queries[:, None, None] - support[None], axis=-1)
        assert np.allclose(episodes[index].distances, distances)
        shared += ((distances.min(axis=2) <= 10).sum(axis=1) > 1).sum()
    assert shared > 10, "some queries are at the places of several ways"


def test_distances_of_an_episode_are_those_of_its_rasters():
    scans = some_scans(places=6, scans=4)
    episodes = EpisodeScheme(ways=4, shots=1, queries=2).training_set(scans, seed=3)
    episode = episodes[5]
    rows = episodes.places.sample(np.random.default_rng([3, 5]))
    order = [*rows[:, 0], *rows[:, 1:].ravel()]
    assert torch.equal(episode.rasters, scans.rasters[order])
    for q, query in enumerate(order[4:]):
        for way, shot in enumerate(order[:4]):
            apart = math.dist(scans.positions[query], scans.positions[shot])
            assert episode.distances[q, way, 0].item() == pytest.approx(apart)


def test_overlapping_ways_need_a_loss_that_knows_several_right_ones():
    method, scheme = DeepRing(deepring_settings(widths=[4, 8])), EpisodeScheme(overlapping=True)
    for one_way in (OneShotCrossEntropy(), Triplet()):
        with pytest.raises(ConfigError, match=r"sampling\.overlapping: true.*graded_cross_entropy"):
            PlaceModule(method, scheme, one_way)
    for graded in (GradedCrossEntropy(), SmoothAp()):
        PlaceModule(method, scheme, graded)
        PlaceModule(method, EpisodeScheme(), graded)
    with pytest.raises(ConfigError, match="expected a subclass of EpisodeLoss"):
        PlaceModule(method, scheme, nn.MSELoss())


@pytest.mark.parametrize("radius", ["positive_radius", "negative_radius"])
def test_radii_of_overlapping_ways_are_lengths_in_any_order(radius):
    EpisodeScheme(positive_radius=10.0, negative_radius=5.0, overlapping=True)
    with pytest.raises(ConfigError, match=rf"sampling\.{radius}: nan"):
        EpisodeScheme(**{radius: math.nan}, overlapping=True)


def test_a_step_of_the_scheme_hands_the_distances_to_a_graded_loss():
    scans = some_scans(places=6, scans=4)
    scheme = EpisodeScheme(ways=3, shots=1, queries=2)
    episode = scheme.training_set(scans, seed=0)[0]
    seen = {}

    class Seen(GradedCrossEntropy):
        def forward(self, queries, support, targets, score):
            seen.update(targets=targets, queries=queries, support=support)
            return super().forward(queries, support, targets, score)

    class Method:
        score = staticmethod(lambda a, b: -torch.cdist(a, b))

        def __call__(self, rasters):
            return rasters.float().flatten(1)

    loss = Seen(scale=6.0)
    scheme.step(Method(), loss, episode)
    assert torch.equal(seen["targets"], loss.targets(episode.distances))
    assert torch.equal(seen["support"][:, 0], episode.rasters[:3].float().flatten(1))
    assert torch.equal(seen["queries"], episode.rasters[3:].float().flatten(1))
