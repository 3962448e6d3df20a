"""Points in balls: the kernel against all distances, sorted by x."""

import pytest
import torch

from deepring.errors import ConfigError, DataError
from deepring.nn.balls import rows_in_balls
from deepring.nn.neighbourhoods import ball_query
from deepring.rasters.downsample import spread


def by_all_distances(centre, points, start, radius, number):
    near = (points - centre).norm(dim=-1) <= radius
    rows = near.nonzero()[:, 0]
    rows = rows[points[rows, 0].sort(stable=True).indices]
    if not len(rows):
        return [-1] * number
    return (start + rows[torch.from_numpy(spread(len(rows), number))]).tolist()


@pytest.mark.parametrize("radius", [0.1, 0.6, 5.0])
@pytest.mark.parametrize("number", [1, 4, 40])
def test_rows_are_those_of_all_distances_spread_over_x(radius, number):
    generator = torch.Generator().manual_seed(0)
    counts = [60, 1, 80]
    points = torch.randn(sum(counts), 3, generator=generator).round(decimals=1)  # with equal x
    centres = torch.randn(3, 20, 3, generator=generator)
    rows = rows_in_balls(centres, points, counts, radius, number)
    starts = [0, 60, 61]
    for k, start in enumerate(starts):
        cloud = points[start : start + counts[k]]
        for centre, found in zip(centres[k], rows[k].tolist(), strict=True):
            assert found == by_all_distances(centre, cloud, start, radius, number)


def test_small_balls_hold_the_same_points_as_a_ball_query():
    points = torch.rand(1, 200, 3, generator=torch.Generator().manual_seed(1))
    ours = rows_in_balls(points, points[0], [200], 0.2, 40)[0]
    theirs = ball_query(points, points, 0.2, 40)[0]
    assert [set(row) for row in ours.tolist()] == [set(row) for row in theirs.tolist()]


def test_the_sample_covers_a_ball_from_one_side_to_the_other():
    """The first ones in the order of x would lie on one side of it."""
    points = torch.zeros(101, 3)
    points[:, 0] = torch.linspace(-1, 1, 101)
    rows = rows_in_balls(torch.zeros(1, 1, 3), points, [101], 1.0, 5)[0, 0]
    assert points[rows, 0].tolist() == pytest.approx([-1.0, -0.6, -0.2, 0.2, 0.6], abs=0.02)


def test_misuse_is_refused():
    points, centres = torch.zeros(4, 3), torch.zeros(1, 2, 3)
    with pytest.raises(DataError, match="counts: 2 clouds of 4 points, expected 1 of 4"):
        rows_in_balls(centres, points, [2, 2], 1.0, 3)
    with pytest.raises(ConfigError, match="radius: 0"):
        rows_in_balls(centres, points, [4], 0.0, 3)
    assert (rows_in_balls(centres, points[:0], [0], 1.0, 3) == -1).all()
