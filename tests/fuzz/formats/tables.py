"""Pose tables of every layout, calib.txt, times.txt, and the file that describes a custom drive."""

import math
import re
import struct
from collections.abc import Callable, Iterator, Mapping
from decimal import Decimal
from pathlib import Path
from random import Random
from typing import Any

from deepring.data.readers import open_session
from fuzz.decoders import poses
from fuzz.decoders.drive_yaml import drive_of
from fuzz.files import Files, Format, Mutation, UndecidedError, UndecodableError
from fuzz.mutations.raw import raw
from fuzz.mutations.text import text
from fuzz.mutations.yaml_keys import yaml_keys
from fuzz.scenes import scene

_SCANS = 6
_START = 1_700_000_000_000_000_000  # nanoseconds
_BASE_LIDAR = poses.of_angles(
    [1.7042, -0.021, 1.8047, *(math.radians(v) for v in (0.0001, 0.0003, 179.6654))]
)
_CAMERA = [0.0, -1.0, 0.0, 0.01, 0.0, 0.0, -1.0, -0.08, 1.0, 0.0, 0.0, -0.27]


def formats() -> Iterator[Format]:
    """All pose tables."""
    yield _table("nclt poses", "2031-01-02/groundtruth_2031-01-02.csv", _nclt(), _nclt_poses)
    yield _table("mulran poses", "Sim01/global_pose.csv", _mulran(), _mulran_poses)
    yield _table("helipr poses", "Sim01/LiDAR_GT/global_Avia_gt.txt", _helipr(), _helipr_poses)
    for file in ("poses.txt", "times.txt", "calib.txt"):
        yield _table(f"kitti {file}", file, _kitti(), _kitti_poses)
    for form in ("tum", "kitti"):
        yield _table(f"custom {form}", "poses.txt", _custom(form), _custom_poses)
    yield _table("drive.yaml", "drive.yaml", _custom("tum"), _custom_poses, yaml_keys("drive.yaml"))


def _table(
    name: str,
    file: str,
    files: Files,
    decode: Callable[[Mapping[str, bytes]], Any],
    *more: Mutation,
) -> Format:
    layout = name.split()[0]
    layout = layout if layout in ("nclt", "mulran", "helipr", "kitti") else "custom"
    mutations = (text(file), text(file), text(file), *more, *more, raw(file))
    return Format(
        name,
        lambda _: files,
        mutations,
        lambda folder: _session(layout, folder),
        decode,
        foreign=True,
    )


def _session(layout: str, folder: Path) -> Any:
    """What a session holds, and one scan of it read."""
    session = open_session(layout, folder / "drive.yaml" if layout == "custom" else folder)
    session.points(0)
    return {
        "files": [path.relative_to(folder).as_posix() for path in session.files],
        "poses": session.poses[:, :3].tolist(),
        "stamps": None if session.stamps is None else session.stamps.tolist(),
    }


def _stated(found: list[tuple[str, int | None, poses.Pose]]) -> Any:
    if not found:
        raise UndecodableError("no scan with a pose")
    stamps = [stamp for _, stamp, _ in found]
    return {
        "files": [file for file, _, _ in found],
        "poses": [pose for _, _, pose in found],
        "stamps": None if None in stamps else stamps,
    }


def _path(k: float) -> tuple[float, float, float]:
    """x, y and heading along a bend."""
    heading = 0.1 * k
    return 20 * math.sin(heading), 20 * (1 - math.cos(heading)), heading


def _rows(between: int = 2) -> list[tuple[int, float, float, float]]:
    """Stamps (ns after the start), x, y and heading, a few for each scan."""
    steps = range(-1, between * _SCANS + 2)
    return [(k * 10**8 // between, *_path(k / between)) for k in steps]


def _xyzi(points: int = 40) -> bytes:
    return b"".join(struct.pack("<4f", *p, 0.5) for p in scene(3, points))


def _nclt() -> Files:
    hits = b"".join(
        struct.pack("<3HBB", *(round((v + 100) / 0.005) for v in p), 1, 2) for p in scene(3, 40)
    )
    start = _START // 1000
    table = "".join(
        f"{start + t // 1000},{x:.6f},{-y:.6f},0.1,0.01,-0.02,{-h:.9f}\n" for t, x, y, h in _rows()
    )
    files = {f"2031-01-02/velodyne_sync/{start + k * 100_000 + 7}.bin": hits for k in range(_SCANS)}
    return {"2031-01-02/groundtruth_2031-01-02.csv": table.encode(), **files}


def _nclt_poses(files: Mapping[str, bytes]) -> Any:
    rows = poses.rows_of(files["2031-01-02/groundtruth_2031-01-02.csv"], ",", "wnnnnnn")
    if any(abs(row[0]) > (2**63 - 1) // 1000 for row in rows):
        raise UndecodableError("stamps beyond 64 bits in nanoseconds")
    stamped = [(int(row[0]) * 1000, poses.of_angles(row[1:])) for row in rows]
    found = _matched(files, "2031-01-02/velodyne_sync/", stamped, 0.05, 1000)
    # x forward, y right, z down becomes x forward, y left, z up.
    flip = [[1.0, 0, 0, 0], [0, -1.0, 0, 0], [0, 0, -1.0, 0]]
    return _stated([(f, t, poses.compose(poses.compose(flip, p), flip)) for f, t, p in found])


def _mulran() -> Files:
    table = "".join(f"{_START + t},{_matrix(x, y, h, ',')}\n" for t, x, y, h in _rows())
    files = {f"Sim01/Ouster/{_START + k * 10**8 + 11}.bin": _xyzi() for k in range(_SCANS)}
    return {"Sim01/global_pose.csv": table.encode(), **files}


def _mulran_poses(files: Mapping[str, bytes]) -> Any:
    rows = poses.rows_of(files["Sim01/global_pose.csv"], ",", "w" + 12 * "n")
    stamped = [(int(row[0]), poses.of_matrix(row[1:])) for row in rows]
    found = _matched(files, "Sim01/Ouster/", stamped, 0.05)
    return _stated([(f, t, poses.compose(p, _BASE_LIDAR)) for f, t, p in found])


def _helipr() -> Files:
    table = "".join(
        f"{_START + t} {x:.6f} {y:.6f} 0.2 0 0 {math.sin(h / 2):.9f} {math.cos(h / 2):.9f}\n"
        for t, x, y, h in _rows()
    )
    record = b"".join(struct.pack("<3f3BI", *p, 1, 2, 3, 4) for p in scene(3, 40))
    files = {f"Sim01/LiDAR/Avia/{_START + k * 10**8 + 13}.bin": record for k in range(_SCANS)}
    return {"Sim01/LiDAR_GT/global_Avia_gt.txt": table.encode(), **files}


def _helipr_poses(files: Mapping[str, bytes]) -> Any:
    rows = poses.rows_of(files["Sim01/LiDAR_GT/global_Avia_gt.txt"], None, "w" + 7 * "n")
    stamped = [(int(row[0]), poses.of_quaternion(row[1:])) for row in rows]
    return _stated(_matched(files, "Sim01/LiDAR/Avia/", stamped, 0.1))


def _matched(
    files: Mapping[str, bytes],
    folder: str,
    stamped: list[tuple[int, poses.Pose | None]],
    tolerance: float,
    unit: int = 1,
) -> list[tuple[str, int, poses.Pose]]:
    scans = {int(f.rpartition("/")[2][:-4]) * unit: f for f in files if f.startswith(folder)}
    found = poses.at_stamps(stamped, sorted(scans), round(tolerance * 1e9))
    return [(scans[stamp], stamp, pose) for stamp, pose in found]


def _kitti() -> Files:
    """A camera's poses, in its first frame: x to the right, y down, z forward."""
    to_camera = poses.of_matrix(_CAMERA)
    rows, times = [], []
    for k in range(_SCANS):
        x, y, h = _path(k)
        pose = poses.of_angles([x, y, 0.0, 0.0, 0.0, h])
        camera = poses.compose(poses.compose(to_camera, pose), poses.inverse(to_camera))
        rows.append(" ".join(f"{value:.9e}" for row in camera for value in row))
        times.append(f"{0.1 * k:.6e}")
    calib = "P0: " + " ".join(["1", "0", "0", "0", "0", "1", "0", "0", "0", "0", "1", "0"]) + "\n"
    calib += "Tr: " + " ".join(f"{value:.12e}" for value in _CAMERA) + "\n"
    files = {f"velodyne/{k:06d}.bin": _xyzi() for k in range(_SCANS)}
    texts = {"poses.txt": "\n".join(rows) + "\n", "times.txt": "\n".join(times) + "\n"}
    return {**{k: v.encode() for k, v in texts.items()}, "calib.txt": calib.encode(), **files}


def _kitti_poses(files: Mapping[str, bytes]) -> Any:
    rows = [poses.of_matrix(row) for row in poses.rows_of(files["poses.txt"], None, 12 * "n")]
    times = [row[0] for row in poses.rows_of(files["times.txt"], None, "n")]
    if len(times) != len(rows) or not all(abs(t) < 9e9 for t in times):
        raise UndecodableError("times other than one per pose")
    to_camera = calibration(files["calib.txt"])
    back, found = poses.inverse(to_camera), []
    for k in range(min(_SCANS, len(rows))):
        if rows[k] is not None:
            pose = poses.compose(poses.compose(back, rows[k]), to_camera)
            found.append((f"velodyne/{k:06d}.bin", round(times[k] * 10**9), pose))
    return _stated(found)


def calibration(content: bytes) -> poses.Pose:
    """Tr of a calib.txt."""
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise UndecodableError("no text") from None
    named = [line.partition(":")[2] for line in lines if line.partition(":")[0].strip() == "Tr"]
    if len(named) > 1:
        raise UndecidedError  # which of them
    if not named:
        whole = [line for line in lines if line.strip()]
        if len(whole) != 1 or ":" in whole[0]:
            raise UndecodableError("no Tr")
        named = whole
    (row,) = poses.rows_of(named[0].encode() or b" ", None, 12 * "n")
    pose = poses.of_matrix(row)
    if pose is None:
        raise UndecodableError("Tr is no rotation and translation")
    return pose


def _custom(form: str) -> Files:
    rows = []
    for k in range(_SCANS):
        x, y, h = _path(k)
        if form == "tum":
            at = f"{(_START + k * 10**8) // 10**9}.{(_START + k * 10**8) % 10**9:09d}"
            turn = f"0 0 {math.sin(h / 2):.9f} {math.cos(h / 2):.9f}"
            rows.append(f"{at} {x:.6f} {y:.6f} 0.1 {turn}")
        else:
            rows.append(_matrix(x, y, h, " "))
    drive = (
        f"scans: scans\nformat: kitti\nposes: poses.txt\npose_format: {form}\nsensor_height: 1.8\n"
        "up: z\nworld_up: z\nz_band: [-1, 20]\nrange: [1, 80]\n"
        "sensor_in_body: [1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 1.8]\n"
    )
    # Names in two schemes: stamps for TUM's rows, numbers for KITTI's.
    names = [f"{_START + k * 10**8}" if form == "tum" else f"{k:06d}" for k in range(_SCANS)]
    files = {f"scans/{name}.bin": _xyzi() for name in names}
    poses_text = "\n".join(rows) + "\n"
    return {"drive.yaml": drive.encode(), "poses.txt": poses_text.encode(), **files}


def _custom_poses(files: Mapping[str, bytes]) -> Any:
    drive = drive_of(files["drive.yaml"])
    table = files.get(drive.poses)
    scans = sorted(f for f in files if f.startswith(f"{drive.scans}/") and f.endswith(".bin"))
    if table is None or not scans:
        raise UndecodableError("no such files")
    if drive.pose_format == "tum":
        rows = poses.rows_of(table, None, 8 * "n")
        stamps: list[int | None] = [_nanoseconds(line) for line in _lines(table)]
        found = [poses.of_quaternion(row[1:]) for row in rows]
        whole = [stamp for stamp in stamps if stamp is not None]
        if whole != sorted(whole) or not all(abs(row[0]) < 9e9 for row in rows):
            raise UndecodableError("stamps out of order")
    else:
        found = [poses.of_matrix(row) for row in poses.rows_of(table, None, 12 * "n")]
        stamps = [None] * len(found)
    if len(found) != len(scans) or None in found:
        raise UndecodableError("other than one pose per scan")
    return _stated(
        [
            (scan, stamp, drive.upright(pose))
            for scan, stamp, pose in zip(scans, stamps, found, strict=True)
            if pose is not None
        ]
    )


def _lines(content: bytes) -> list[str]:
    lines = re.split(r"\r\n|\n|\r", content.decode("utf-8-sig"))
    return [line for line in (line.partition("#")[0].strip() for line in lines) if line]


def _nanoseconds(line: str) -> int:
    seconds = Decimal(line.split()[0])
    if not seconds.is_finite():
        raise UndecodableError("a stamp that is no number")
    return round(seconds * 10**9)


def _matrix(x: float, y: float, heading: float, separator: str) -> str:
    pose = poses.of_angles([x, y, 0.1, 0.01, -0.02, heading])
    assert pose is not None
    return separator.join(f"{value:.9f}" for row in pose for value in row)


__all__ = ["Random", "formats"]
