"""OverlapNet: the published shapes and numbers of parameters, turns, candidates, refusals."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from deepring.core.rigid import turn_points
from deepring.errors import ConfigError
from deepring.methods.method import index_of
from deepring.methods.overlapnet import OverlapNet, OverlapNetSettings, mean_columns
from deepring.methods.overlapnet.legs import PUBLISHED, checked_layers, sizes
from deepring.testing import check_method, walls
from helpers.tiny_methods import TINY, TINY_OVERLAPNET


def parameters(module):
    return sum(p.numel() for p in module.parameters())


def network(**changes):
    torch.manual_seed(0)
    return OverlapNet(replace(TINY_OVERLAPNET, **changes)).eval()


def described(method, *scans):
    return method.describe(np.stack([method.raster(points, 0.0) for points in scans]))


def test_the_published_layers_have_the_published_shapes():
    shapes = sizes(checked_layers(PUBLISHED), 900, 64, circular=False)
    assert shapes == [
        *((443, 30), (429, 14), (415, 6), (404, 2), (396, 1)),
        *((388, 1), (380, 1), (372, 1), (366, 1), (362, 1), (360, 1)),
    ]
    method = OverlapNet()
    assert method.descriptor_shape == (360, 128)
    assert parameters(method.legs) == 1_104_112
    assert parameters(method.head) == 665_025
    assert parameters(method) == 1_769_137
    assert method.describe(method.raster(walls(0), 0.0)[None]).shape == (1, 360, 128)
    assert method.head.last.in_features == 22 * 22 * 256


def test_32_rows_need_one_step_less():
    layers = [(5, 15, 1, 2, 16), *PUBLISHED[1:]]
    assert [rows for _, rows in sizes(checked_layers(layers), 900, 32, circular=False)][:5] == [
        *(28, 13, 6, 2, 1)
    ]


def test_around_the_seam_a_roll_of_the_image_rolls_the_columns():
    method = network()
    images = torch.from_numpy(np.stack([method.raster(walls(k), 0.0) for k in range(2)])).float()
    columns = method(images)
    assert torch.allclose(method(images.roll(2, dims=2)), columns.roll(1, dims=1), atol=1e-5)
    plain = network(circular=False, block=6)
    assert plain.columns < method.columns
    rolled = plain(images.roll(2, dims=2))
    assert not torch.allclose(rolled, plain(images).roll(1, dims=1), atol=1e-3)  # blind at the seam


@pytest.mark.parametrize("sectors", [2, 16, 58])
def test_the_turn_is_of_the_points_from_entry_to_query(sectors):
    method = network()
    turn = 2 * math.pi * sectors / method.raster.sectors
    entries = described(method, *(walls(k) for k in range(4)))
    queries = described(method, *(turn_points(walls(k), turn) for k in range(4)))
    found = method.compare(queries, entries).turn.diagonal().double()
    away = torch.remainder(found - turn + math.pi, 2 * math.pi) - math.pi
    assert float(away.abs().max()) < 1e-5
    curves = method.turn_curves(queries, entries)
    assert curves.argmax(dim=1).tolist() == [sectors // 2] * 4
    opposite = method.turn_curves(entries, queries).argmax(dim=1)
    assert opposite.tolist() == [method.columns - sectors // 2] * 4


def test_columns_that_are_rolled_correlate_best_where_they_are_rolled_back():
    method, columns = network(), torch.rand(3, 32, 6)
    for shift in (0, 1, 31):
        curves = method.turn_curves(columns.roll(shift, dims=1), columns)
        assert curves.argmax(dim=1).tolist() == [shift] * 3
        by_sum = torch.stack(
            [(columns.roll(shift, 1) * columns.roll(k, 1)).sum((1, 2)) for k in range(32)], dim=1
        )
        assert torch.allclose(curves, by_sum, rtol=1e-4)


def head_by_loop(head, first, second):
    """The layers on one pair, block by block."""
    block = head.across.kernel_size[1]
    blocks = len(first) // block
    apart = (first[:, None] - second[None]).abs()
    across = (
        torch.stack(
            [
                torch.einsum(
                    "ijc,ocj->io",
                    apart[:, b * block : (b + 1) * block],
                    head.across.weight[:, :, 0],
                )
                for b in range(blocks)
            ],
            dim=1,
        )
        + head.across.bias
    )
    along = (
        torch.stack(
            [
                torch.einsum(
                    "ibc,oci->bo", across[a * block : (a + 1) * block], head.along.weight[..., 0]
                )
                for a in range(blocks)
            ]
        )
        + head.along.bias
    )
    x = torch.nn.functional.conv2d(
        along.relu().permute(2, 0, 1)[None], head.around.weight, head.around.bias
    )
    return head.last(x.relu().flatten(1))[0, 0]


def test_the_head_takes_every_column_of_the_first_with_every_one_of_the_second():
    method = network()
    first, second = torch.rand(2, method.columns, 6), torch.rand(2, method.columns, 6)
    found = method.overlap_logits(first, second)
    expected = [head_by_loop(method.head, a, b) for a, b in zip(first, second, strict=True)]
    assert torch.allclose(found, torch.stack(expected), atol=1e-4)
    assert not torch.allclose(found, method.overlap_logits(second, first))


def test_only_candidates_are_compared():
    method, every = network(candidates=2), network()
    every.load_state_dict(method.state_dict())
    scans = [walls(k) for k in range(6)]
    entries = described(method, *scans)
    queries = described(method, *(turn_points(points, math.pi / 2) for points in scans))
    assert torch.allclose(mean_columns(queries), mean_columns(entries), atol=1e-5)
    score, turn = method.compare(queries, entries)
    assert ((score >= 0).sum(dim=1) == 2).all()
    assert (score.diagonal() >= 0).all()
    whole = every.compare(queries, entries)
    assert torch.allclose(score[score >= 0], whole.score[score >= 0], atol=1e-6)
    assert torch.equal(turn, whole.turn)
    assert ((whole.score > 0) & (whole.score < 1)).all()
    index = index_of(method)
    index.add(entries)
    hits = index.search(queries, k=6)
    assert hits.place.shape == (6, 2)
    assert torch.allclose(hits.score, score.gather(1, hits.place), atol=1e-6)


def test_it_is_a_method():
    for changes in ({}, {"candidates": 3}, {"aligned": True}):
        assert check_method(TINY["overlapnet"](**changes)) == {}


def test_aligned_columns_overlap_whatever_the_turn():
    plain, aligned = TINY["overlapnet"](), TINY["overlapnet"](aligned=True)
    scans = [walls(k) for k in range(4)]
    entries = described(plain, *scans)
    queries = described(plain, *(turn_points(points, math.pi / 2) for points in scans))
    same = aligned.compare(entries, entries).score.diagonal()
    assert torch.allclose(aligned.compare(queries, entries).score.diagonal(), same, atol=0.01)
    fallen = plain.compare(queries, entries).score.diagonal()
    assert (fallen < same - 0.05).all()  # as published, a turn is less overlap


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"layers": []}, "overlapnet.layers: none"),
        ({"layers": [[5, 5, 2, 2]]}, r"overlapnet.layers\[0\]: \[5, 5, 2, 2\], expected five"),
        ({"layers": [[5, 5, 2, 0, 4]]}, r"overlapnet.layers\[0\]: 0, expected"),
        ({"layers": [[5, 5, 2, 2, 4]]}, "overlapnet.layers: 4 of the 12 rows of the raster"),
        ({"layers": [[13, 5, 2, 2, 4]]}, r"overlapnet.layers\[0\]: .* on an image of 12 rows"),
        ({"layers": [[12, 5, 1, 3, 4]]}, r"overlapnet.layers\[0\]: .*a step that divides"),
        ({"block": 11}, "overlapnet.block: 11, expected at most a third of the 32 columns"),
        ({"widths": [4, 4]}, r"overlapnet.widths: \[4, 4\], expected three"),
        ({"candidates": 0}, "overlapnet.candidates: 0"),
        ({"circular": 1}, "overlapnet.circular: a int, expected a bool"),
    ],
)
def test_wrong_settings_are_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        network(**settings)
    with pytest.raises(ConfigError, match="OverlapNet: raster"):
        OverlapNet(OverlapNetSettings({"kind": "polar"}))
