"""Places of a cloud: on level ground with free space above it, or beneath a path."""

import numpy as np
import pytest

from deepring.data.clouds.tiles import TiledCloud
from deepring.data.poses.path_file import read_path
from deepring.errors import DataError, FileError
from deepring.localization.clouds.path_places import ground_beneath, path_places
from deepring.localization.clouds.standing_places import ground_grid, standing_places
from helpers.clouds import ground, in_tiles, wall

HEIGHT, APART = 1.73, 0.2


def places(points, spacing=5.0, side=40.0) -> np.ndarray:
    return standing_places(in_tiles(points, side), HEIGHT, spacing, APART)


def block(x, y, half, top):
    """A house of walls without points inside, and its flat roof."""
    corners = np.array([[x - half, y - half], [x + half, y - half], [x + half, y + half],
                        [x - half, y + half]])  # fmt: skip
    walls = [wall(corners[k], corners[(k + 1) % 4], 0, top) for k in range(4)]
    return [*walls, ground(-half, half, 0.2, top) + np.array([x, y, 0])]


def test_open_ground_gives_a_place_in_each_square_on_the_ground():
    found = places(ground(-30, 30, 0.2, z=4.0))
    squares = {tuple(square) for square in np.floor(found[:, :2] / 5).astype(int).tolist()}
    assert len(found) == len(squares)
    assert len(found) >= 100
    np.testing.assert_allclose(found[:, 2], 4.0, atol=0.1)
    middles = (np.floor(found[:, :2] / 5) + 0.5) * 5
    assert np.median(np.linalg.norm(found[:, :2] - middles, axis=1)) < 1.0


def test_a_slope_and_a_kerb_are_ground_and_a_steep_bank_is_not():
    street = ground(-30, 30, 0.2)
    street[:, 2] += 0.15 * street[:, 0] + 0.12 * (street[:, 1] > 10)
    assert len(places(street)) > 100
    bank = ground(-30, 30, 0.2)
    bank[:, 2] += 1.5 * bank[:, 0]
    assert not len(places(bank))


def test_nothing_stands_in_walls_on_roofs_and_under_what_is_low():
    low = ground(-8, 0, 0.2, z=1.5) + np.array([0, 12, 0])  # a table
    high = ground(-8, 0, 0.2, z=4.0) + np.array([0, -20, 0])  # a bridge
    inside = (np.abs(ground(-30, 30, 0.2)[:, :2] - [15, 0]) < 6).all(axis=1)
    points = np.concatenate([ground(-30, 30, 0.2)[~inside], *block(15, 0, 6, 5), low, high])
    found = places(points, 2.0)
    assert len(found) > 300
    assert found[:, 2].max() < 0.3

    def near(x, y, half):
        return (np.abs(found[:, :2] - [x, y]) < half).all(axis=1).sum()

    assert near(15, 0, 5.5) == 0
    assert near(-4, 8, 3.0) == 0
    assert near(-4, -24, 3.0) > 2


def test_the_blocks_that_are_looked_at_leave_no_seams():
    points = ground(-130, 130, 0.5)
    cloud = in_tiles(points, 40.0)
    found = standing_places(cloud, HEIGHT, 7.0, 0.35)
    squares = {tuple(square) for square in np.floor(found[:, :2] / 7).astype(int).tolist()}
    inner = [(i, j) for i in range(-17, 17) for j in range(-17, 17)]
    assert squares >= set(inner)
    assert len(found) == len(squares)


def test_single_points_below_the_ground_are_not_the_ground():
    rng = np.random.default_rng(0)
    below = np.column_stack([rng.uniform(-20, 20, (200, 2)), rng.uniform(-9, -2, 200)])
    points = np.concatenate([ground(-20, 20, 0.2), below])
    grid = ground_grid(in_tiles(points), np.array([-15.0, -15]), np.array([15.0, 15]), HEIGHT, 0.2)
    assert np.nanmedian(np.abs(grid.height)) < 0.1
    assert len(places(points)) > 30


def test_a_bridge_is_the_ground_of_those_who_drive_on_it():
    points = np.concatenate([ground(-20, 20, 0.2), ground(-20, 20, 0.2, z=6.0)])
    cloud: TiledCloud = in_tiles(points)
    for z, expected in ((1.7, 0.0), (0.1, 0.0), (7.7, 6.0), (6.2, 6.0)):
        assert ground_beneath(cloud, np.array([0.0, 0.0, z])) == pytest.approx(expected, abs=0.1)
    assert np.isnan(ground_beneath(cloud, np.array([0.0, 0.0, 30.0])))
    assert np.isnan(ground_beneath(cloud, np.array([500.0, 0.0, 1.0])))


def test_places_along_a_path_are_on_the_ground_and_none_is_twice():
    points = ground(-60, 60, 0.3)
    points[:, 2] += 0.05 * points[:, 0]
    x = np.concatenate([np.arange(-50, 50, 1.0), np.arange(50, -50, -1.0)])
    path = np.column_stack([x, np.zeros_like(x), 0.05 * x + 1.9])
    found = path_places(in_tiles(points), path, 10.0)
    assert found.off == 0
    assert len(found.rows) in (9, 10)
    np.testing.assert_allclose(found.positions[:, 2], 0.05 * found.positions[:, 0], atol=0.15)
    np.testing.assert_array_equal(found.positions[:, :2], path[found.rows, :2])


@pytest.mark.parametrize(
    ("shift", "message"),
    [
        ([5000, 0, 0], r"10 of 10 places have no ground .* 10 lie beside it: path x 49\d\d to"),
        ([0, 0, 40], r".*41\.\d m above the lowest points there"),
        ([0, 0, -40], r".*38\.\d m below the lowest points there"),
    ],
)
def test_a_path_that_does_not_lie_in_the_cloud(shift, message):
    x = np.arange(-50.0, 50.0)
    path = np.column_stack([x, 0 * x, 0 * x + 1.7]) + shift
    with pytest.raises(DataError, match=f"^path: {message}"):
        path_places(in_tiles(ground(-60, 60, 0.3)), path, 10.0)


def test_some_of_a_path_may_leave_the_cloud_and_are_counted():
    x = np.arange(-50.0, 72.0)
    path = np.column_stack([x, 0 * x, 0 * x + 1.7])
    found = path_places(in_tiles(ground(-60, 60, 0.3)), path, 10.0)
    assert found.off == 1
    assert len(found.rows) == 11


def test_a_cloud_of_walls_alone_has_no_ground_beneath_a_path():
    x = np.arange(-50.0, 50.0)
    path = np.column_stack([x, 0 * x, 0 * x + 1.7])
    walls = np.concatenate([wall([-60, y], [60, y], 0.5, 6) for y in (-2.6, 2.6)])
    with pytest.raises(DataError, match=r"no level surface|above the lowest"):
        path_places(in_tiles(walls), path, 10.0)


def test_paths_are_read_in_both_formats(tmp_path):
    (tmp_path / "a.tum").write_text("# path\n1.5 10 20 30 0 0 0 1\n2.5 11 21 31 0 0 0 1\n")
    (tmp_path / "a.txt").write_text("1 0 0 10 0 1 0 20 0 0 1 30\n1 0 0 11 0 1 0 21 0 0 1 31\n")
    for name in ("a.tum", "a.txt"):
        assert read_path(tmp_path / name).tolist() == [[10, 20, 30], [11, 21, 31]]
    for text in ("", "1 2 3\n", "1 2 3 4 5 6 7 x\n", "1 nan 3 4 0 0 0 1\n"):
        (tmp_path / "b.tum").write_text(text)
        with pytest.raises(FileError, match=r"b\.tum"):
            read_path(tmp_path / "b.tum")
    with pytest.raises(FileError, match="no such file"):
        read_path(tmp_path / "none.tum")
