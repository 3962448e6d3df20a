"""Scans written wrongly: of other types, widths, units, axes and frames than their reader expects.

Each function of `WRONG` takes points (n, 3) float64, metres, in the sensor's frame, and the pose
(4, 4); it returns the bytes of a .bin file, a whole number of KITTI's records long.
"""

import numpy as np


def rows(points, width, kind="<f4"):
    """Points with ``width`` values each: x, y, z, and fields that sensors add."""
    rng = np.random.default_rng(len(points))
    n = len(points)
    others = [
        *(rng.random(n), rng.integers(0, 64, n), rng.uniform(0, 0.1, n)),
        *(rng.integers(0, 256, n), rng.uniform(0, 60, n), rng.random(n), rng.random(n)),
    ]
    return np.column_stack([points, *others[: width - 3]]).astype(kind)


def whole_records(array):
    """Bytes of the rows, so many that they are also a whole number of KITTI's records."""
    rows_of_both = np.lcm(array.itemsize * array.shape[1], 16) // (array.itemsize * array.shape[1])
    return array[: len(array) // rows_of_both * rows_of_both].tobytes()


def _world(points, pose):
    return rows(points @ pose[:3, :3].T + pose[:3, 3], 4)


def _intensity_for_z(points, most):
    intensity = np.random.default_rng(0).integers(0, 256, len(points)) * (most / 255)
    return rows(np.column_stack([points[:, :2], intensity]), 4)


_UP_TO_60 = np.array([60, 1, 1, 1], dtype="<f4")

WRONG = {
    "float64": lambda p, _: rows(p, 4, "<f8"),
    "float64 without intensity": lambda p, _: rows(p, 3, "<f8"),
    "float64 with a ring": lambda p, _: rows(p, 5, "<f8"),
    "big-endian": lambda p, _: rows(p, 4, ">f4"),
    "big-endian float64": lambda p, _: rows(p, 4, ">f8"),
    "float16": lambda p, _: rows(p, 4, "<f2"),
    "int32 of millimetres": lambda p, _: np.rint(rows(p, 4, "<f8") * 1000).astype("<i4"),
    "int16 of centimetres": lambda p, _: np.rint(rows(p, 4, "<f8") * 100).astype("<i2"),
    "three values": lambda p, _: rows(p, 3),
    "five values": lambda p, _: rows(p, 5),
    "six values": lambda p, _: rows(p, 6),
    "seven values": lambda p, _: rows(p, 7),
    "eight values": lambda p, _: rows(p, 8),
    "columns": lambda p, _: rows(p[: len(p) // 4 * 4], 4).T,
    "millimetres": lambda p, _: rows(p * 1000, 4),
    "centimetres": lambda p, _: rows(p * 100, 4),
    "kilometres": lambda p, _: rows(p / 1000, 4),
    "feet": lambda p, _: rows(p / 0.3048, 4),
    "scaled to 1": lambda p, _: rows(p / np.abs(p).max(), 4),
    "UTM": lambda p, _: rows(p + np.array([345000, 4037000, 50]), 4),
    "the map's frame": _world,
    "z down": lambda p, _: rows(p * [1, -1, -1], 4),
    "a camera's axes": lambda p, _: rows(np.column_stack([-p[:, 1], -p[:, 2], p[:, 0]]), 4),
    "y up": lambda p, _: rows(np.column_stack([p[:, 0], p[:, 2], -p[:, 1]]), 4),
    "intensity for z": lambda p, _: _intensity_for_z(p, 255),
    "intensity of 0 to 1 for z": lambda p, _: _intensity_for_z(p, 1),
    "one plane": lambda p, _: rows(p * [1, 1, 0], 4),
    "intensity first": lambda p, _: rows(p, 4)[:, [3, 0, 1, 2]],
    "intensity of 0 to 60 first": lambda p, _: rows(p, 4)[:, [3, 0, 1, 2]] * _UP_TO_60,
}

#: What the advice must name, where another reading of the same bytes or points is plausible.
NAMED = {
    "float64": "float64 with 4 values",
    "float64 without intensity": "float64 with 3 values",
    "float64 with a ring": "float64 with 5 values",
    "big-endian": "big-endian float32 with 4 values",
    "big-endian float64": "big-endian float64 with 4 values",
    "float16": "float16 with 4 values",
    "three values": "float32 with 3 values",
    "five values": "float32 with 5 values",
    "six values": "float32 with 6 values",
    "seven values": "float32 with 7 values",
    "eight values": "float32 with 8 values",
    "columns": "all x before all y",
    "millimetres": "points in millimetres",
    "centimetres": "points in centimetres",
    "kilometres": "points in kilometres",
    "feet": "points in feet",
    "z down": "z down",
    "a camera's axes": "a camera's",
    "y up": "y up",
    "intensity first": "the second to fourth column",
    "intensity of 0 to 60 first": "the second to fourth column",
}

#: Wrong in ways that a scan may happen to look like: doubted, and not refused.
DOUBTED = ("intensity of 0 to 1 for z",)


def write_wrong(folder, kind, clouds, poses):
    """A drive in KITTI's layout whose scans are wrong in this way; "right" gives a good one."""
    (folder / "velodyne").mkdir(parents=True)
    for k, (cloud, pose) in enumerate(zip(clouds, poses, strict=True)):
        points = np.asarray(cloud, dtype=np.float64)
        array = rows(points, 4) if kind == "right" else WRONG[kind](points, pose)
        (folder / "velodyne" / f"{k:06d}.bin").write_bytes(whole_records(array))
    (folder / "calib.txt").write_text("Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")
    lines = [" ".join(repr(float(v)) for v in pose[:3].ravel()) for pose in poses]
    (folder / "poses.txt").write_text("\n".join(lines) + "\n")
    return folder
