"""Clouds out of files: all formats give the same points, tiles lose none, bad ones are refused."""

import laspy
import numpy as np
import pytest
from scipy.spatial import KDTree

from deepring.data.clouds import cloud_file
from deepring.data.clouds.autoware import METADATA
from deepring.data.clouds.cloud_file import open_cloud_file
from deepring.data.clouds.open_cloud import is_cloud, open_cloud
from deepring.data.clouds.plausibility import expect_plausible
from deepring.data.clouds.sorted_tiles import SIDE
from deepring.data.clouds.voxels import VOXEL, thinned
from deepring.errors import DataError, FileError
from fuzz.decoders.lzf import compress
from helpers.clouds import ground, pcd_bytes, street, wall

FAR = np.array([345678.0, 4037654.0, 120.0])


def las(path, points, compressed=False):
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales, header.offsets = [1e-3] * 3, np.floor(points.min(axis=0))
    record = laspy.LasData(header)
    record.x, record.y, record.z = points.T
    record.write(path.with_suffix(".laz" if compressed else ".las"))


def ply(path, points, form):
    head = (
        f"ply\nformat {form} 1.0\nelement vertex {len(points)}\nproperty double x\n"
        "property double y\nproperty double z\nproperty uchar red\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        rows = "".join(f"{x!r} {y!r} {z!r} 9\n" for x, y, z in points.tolist()).encode()
        body = rows + b"3 0 1 2\n"
    else:
        order = "<" if "little" in form else ">"
        rows = np.zeros(len(points), [("p", f"{order}f8", (3,)), ("c", "u1")])
        rows["p"] = points
        face = np.array([(3, (0, 1, 2))], [("n", "u1"), ("v", f"{order}i4", (3,))])
        body = rows.tobytes() + face.tobytes()
    path.write_bytes(head + body)


def compressed_pcd(points):
    head = pcd_bytes(points, "f8").split(b"DATA")[0] + b"DATA binary_compressed\n"
    raw = points.astype("<f8").T.tobytes()
    packed = compress(raw)
    return head + np.array([len(packed), len(raw)], "<u4").tobytes() + packed


WRITERS = {
    "a.pcd": lambda path, points: path.write_bytes(pcd_bytes(points, "f8")),
    "text.pcd": lambda path, points: path.write_bytes(pcd_bytes(points, "f8", "ascii")),
    "packed.PCD": lambda path, points: path.write_bytes(compressed_pcd(points)),
    "a.ply": lambda path, points: ply(path, points, "binary_little_endian"),
    "big.ply": lambda path, points: ply(path, points, "binary_big_endian"),
    "text.ply": lambda path, points: ply(path, points, "ascii"),
    "a.las": las,
    "a.laz": lambda path, points: las(path, points, compressed=True),
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_points_some_at_a_time(name, tmp_path, monkeypatch):
    """In world coordinates, to the millimetre, which single precision does not have there."""
    monkeypatch.setattr(cloud_file, "CHUNK", 300)
    monkeypatch.setattr(cloud_file, "_LINES", 300)
    monkeypatch.setattr("deepring.data.clouds.las._CHUNK", 300)
    points = FAR + np.random.default_rng(0).uniform(-50, 50, (1000, 3))
    WRITERS[name](tmp_path / name, points)
    file = open_cloud_file(tmp_path / name)
    chunks = list(file.chunks())
    assert file.points == 1000
    assert [len(chunk.points) for chunk in chunks] == [300, 300, 300, 100]
    np.testing.assert_allclose(np.concatenate([c.points for c in chunks]), points, atol=6e-4)
    assert not any(chunk.single for chunk in chunks)


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_that_is_cut_is_refused(name, tmp_path):
    WRITERS[name](tmp_path / name, FAR + np.random.default_rng(0).uniform(-50, 50, (1000, 3)))
    whole = (tmp_path / name).read_bytes()
    for share in (0.0, 0.01, 0.3, 0.95):
        (tmp_path / name).write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(DataError, match=r"^cloud .*expected a (complete|point)") as raised:
            list(open_cloud_file(tmp_path / name).chunks())
        assert "\n" not in str(raised.value)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.xyz").write_text("1 2 3\n")
    with pytest.raises(FileError, match=r"ending '\.xyz', expected \.pcd, \.ply, \.las, \.laz"):
        open_cloud_file(tmp_path / "a.xyz")
    with pytest.raises(FileError, match="no such file"):
        open_cloud_file(tmp_path / "b.pcd")
    (tmp_path / "c.las").write_bytes(b"ply\nformat ascii 1.0\n" * 50)
    with pytest.raises(DataError, match="no LAS header"):
        open_cloud_file(tmp_path / "c.las")


def test_thinned_keeps_the_first_point_of_each_voxel():
    points = np.random.default_rng(0).uniform(-1, 1, (3000, 3)).astype(np.float32)
    kept = thinned(points)
    cells = [tuple(cell) for cell in np.floor(points / np.float32(VOXEL)).astype(int).tolist()]
    first = [k for k, cell in enumerate(cells) if cell not in cells[:k]]
    np.testing.assert_array_equal(kept, points[first])


def everything(cloud):
    return np.concatenate([cloud.points_of(k) + t.corner for k, t in enumerate(cloud.tiles)])


def test_sorting_into_tiles_loses_and_moves_no_point(tmp_path, monkeypatch):
    monkeypatch.setattr(cloud_file, "CHUNK", 5000)
    points = FAR + np.random.default_rng(0).uniform([-90, -90, 5], [90, 90, 9], (20_000, 3))
    broken = np.concatenate([points, [[np.nan, 0, 0], [0, 0, 0], [np.inf, 1, 1]]])
    (tmp_path / "a.pcd").write_bytes(pcd_bytes(broken, "f8"))
    with open_cloud(tmp_path / "a.pcd") as cloud:
        cloud.passing = True
        found = everything(cloud)
        for k, tile in enumerate(cloud.tiles):
            local = cloud.points_of(k)[:, :2]
            assert local.min() >= 0
            assert local.max() <= SIDE
            assert (tile.size == SIDE).all()
        middle = FAR + np.array([10, -10, 0])
        near = cloud.within(middle[:2] - 20, middle[:2] + 20, middle) + middle
    assert 0.98 * len(points) < len(found) <= len(points)
    order = np.lexsort(points.T)
    rank = np.searchsorted(points[order, 2], found[:, 2] - 1e-4)
    assert np.abs(points[order][rank.clip(0, len(points) - 1), 2] - found[:, 2]).max() < 1e-3
    inside = (np.abs(found[:, :2] - middle[:2]) < 20).all(axis=1)
    assert abs(len(near) - inside.sum()) <= 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p * 1e3, "points are .* m apart .*expected an area in metres: check the unit"),
        (lambda p: p * 1e2, "check the unit"),
        (lambda p: p * 1e-3, r"all lie within 0\.0\d+ x 0\.0\d+ m, no area"),
        (lambda p: p[:, [0, 2, 1]], "y seems to be vertical .*expected z up"),
        (lambda p: p[:, [2, 0, 1]], "x seems to be vertical"),
        (lambda p: p * [1, -1, -1], "z seems to point down"),
        (lambda p: p + FAR, r"single precision \(float32\), which has steps of 0\.25 m"),
        (lambda p: p * np.nan, "points, all of them NaN, infinite or"),
        (lambda p: p[:0], "no points"),
    ],
)
def test_clouds_that_cannot_be_are_refused(change, message, tmp_path):
    (tmp_path / "a.pcd").write_bytes(pcd_bytes(change(street()), "f4"))
    with (
        pytest.raises(DataError, match=message),
        open_cloud(tmp_path / "a.pcd") as cloud,
    ):
        expect_plausible(cloud)


def test_a_cloud_that_can_be_is_taken(tmp_path):
    for name, points in {"near": street(1), "far": street(2) + FAR}.items():
        (tmp_path / f"{name}.pcd").write_bytes(pcd_bytes(points, "f8"))
        with open_cloud(tmp_path / f"{name}.pcd") as cloud:
            expect_plausible(cloud)


def tiles(folder, points, size=30.0, metadata=None, name=METADATA):
    """A cloud as Autoware has it."""
    folder.mkdir(parents=True)
    keys = np.floor(points[:, :2] / size).astype(int)
    lines = [f"x_resolution: {size}", f"y_resolution: {size}"]
    for i, j in np.unique(keys, axis=0):
        part = points[(keys == [i, j]).all(axis=1)]
        (folder / f"{i}_{j}.pcd").write_bytes(pcd_bytes(part))
        lines.append(f"{i}_{j}.pcd: [{i * size}, {j * size}]")
    (metadata or folder).joinpath(name).write_text("\n".join(lines) + "\n")
    return lines


@pytest.mark.parametrize("layout", ["inside", "beside", "above"])
def test_autowares_tiles_are_the_cloud(layout, tmp_path):
    points = street(3)
    inner = tmp_path / "map" / ("pointcloud_map.pcd" if layout != "inside" else "tiles")
    (tmp_path / "map").mkdir()
    tiles(inner, points, metadata=inner.parent if layout != "inside" else None)
    given = inner.parent if layout == "above" else inner
    (tmp_path / "one.pcd").write_bytes(pcd_bytes(points))
    assert is_cloud(given)
    with open_cloud(given) as cloud, open_cloud(tmp_path / "one.pcd") as whole:
        expect_plausible(cloud)
        assert cloud.points == whole.points == len(points)
        some, others = everything(cloud), everything(whole)
    # Voxels begin at the corners of tiles: other points of the same surfaces are kept.
    for one, other in ((some, others), (others, some)):
        assert (KDTree(one).query(other)[0] < 0.5).mean() > 0.99


def test_tiles_and_metadata_have_to_agree(tmp_path):
    lines = tiles(tmp_path / "t", street(4))
    metadata = tmp_path / "t" / METADATA

    def refused(text, error, message):
        metadata.write_text(text)
        with pytest.raises(error, match=message), open_cloud(tmp_path / "t") as cloud:
            everything(cloud)

    text = "\n".join(lines)
    refused(text + "\nother.pcd: [300, 300]", FileError, "1 of its .* tiles are not in .*other.pcd")
    refused(text.replace("x_resolution", "x"), FileError, "no x_resolution")
    refused(text + "\n9.pcd: 7", FileError, r"9\.pcd: 7, expected \[x, y\]")
    refused(text + "\n../9.pcd: [1, 2]", FileError, "expected names of .pcd files")
    refused(text + "\n9.pcd: [0.0, 0.0]", FileError, "lie both at 0, 0")
    refused("[1, 2]", FileError, "expected x_resolution")
    refused("x_resolution: 20\ny_resolution: -1", FileError, "expected more than 0")
    refused("x_resolution: 20\ny_resolution: 20", FileError, "names no tile")
    refused("a: [", FileError, "invalid YAML")
    refused(text.replace("[0.0, 0.0]", "[900.0, 0.0]"), DataError, "lie outside of their tile")
    metadata.write_text("\n".join(lines[:-1]))
    told = []
    with open_cloud(tmp_path / "t", told.append):
        pass
    assert len(told) == 1
    assert "left out 1 files" in told[0]
    metadata.unlink()
    assert is_cloud(tmp_path / "t")
    with pytest.raises(FileError, match=f"no {METADATA}"), open_cloud(tmp_path / "t"):
        pass


def test_a_folder_of_las_files_is_one_cloud(tmp_path):
    points = street(5) + FAR
    left = points[:, 0] < FAR[0]
    las(tmp_path / "a.las", points[left])
    las(tmp_path / "b.las", points[~left], compressed=True)
    assert is_cloud(tmp_path)
    with open_cloud(tmp_path) as cloud:
        assert cloud.points == len(points)
        expect_plausible(cloud)
    (tmp_path / "c.pcd").write_bytes(b"")
    told = []
    with open_cloud(tmp_path, told.append):
        assert told == [f"{tmp_path}: left out 1 files beside the .las files, first c.pcd"]


def test_what_passed_is_left_out_and_what_stands_is_not(tmp_path):
    """Cars that drove by have ground below them; parked ones, walls and trees have not."""
    road = ground(-20, 20, 0.2)
    car = np.concatenate([wall([x, -1], [x, 1], 0.5, 1.6) for x in np.arange(-8, 8, 0.2)])
    hole = (np.abs(road[:, :2] - [0, 10]) < [2.4, 1.2]).all(axis=1)
    parked = np.concatenate([wall([-2, y], [2, y], 0.3, 1.6) for y in (9.2, 10.0, 10.8)])
    house = wall([-18, -15], [18, -15], 0.3, 6)
    behind = road[:, 1] < -15.0
    canopy = wall([5, 15], [8, 15], 4.2, 8)
    points = np.concatenate([road[~hole & ~behind], car, parked, house, canopy])
    (tmp_path / "a.pcd").write_bytes(pcd_bytes(points))
    with open_cloud(tmp_path / "a.pcd") as cloud:
        kept = everything(cloud)
    above = kept[kept[:, 2] > 0.45]
    assert (np.abs(above[:, 1]) < 2).sum() == 0
    assert (np.abs(above[:, 1] - 10) < 1).sum() > 50
    assert (np.abs(above[:, 1] + 15) < 0.3).sum() > 500
    assert (np.abs(above[:, 1] - 15) < 0.3).sum() > 50
