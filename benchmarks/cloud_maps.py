"""Scans located in maps that are built of a point cloud.

    python benchmarks/cloud_maps.py kitti=FOLDER sim_nclt=outputs/datasets/sim_nclt_seed0 \\
      sim_mulran=outputs/datasets/sim_mulran_seed0 [--every 2]

The scans of the map's session (of KITTI: the first passes) are fused with their poses and written
to one PCD file. Of that file two maps are built: along the path of the poses, and without it. The
queries are the scans of the other session (of KITTI: the revisits), every 5 m, each turned by a
random yaw, as far as they were taken within 10 m of the path. Located: within 2 m and 5°; recall
of trust: of the located ones.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from cloud_on_disk import write_pcd
from numpy.typing import NDArray
from scipy.spatial import KDTree

from deepring.cli.process import tune_process
from deepring.core.rigid import moved_points, turn_points, yaw_of
from deepring.data.clouds.open_cloud import open_cloud
from deepring.data.readers import ground_of, list_sessions, open_session
from deepring.data.scans.returns import is_return
from deepring.data.session import Session
from deepring.data.spacing import revisits, sample_by_distance
from deepring.localization.clouds.cloud_map import map_of_cloud
from deepring.localization.clouds.virtual_scan import VirtualSensor
from deepring.localization.map import Map
from deepring.methods.network_file import load_network

#: Format, and height and field of view of the sensor, of each kind of dataset.
KINDS = {
    "kitti": ("kitti", VirtualSensor()),
    "sim_nclt": ("nclt", VirtualSensor(height=1.0, fov=(-31.0, 11.0))),
    "sim_mulran": ("mulran", VirtualSensor(height=1.8, fov=(-17.0, 17.0))),
}
#: Metres from a sensor up to which its points are fused.
FUSED = 80.0


class Data(NamedTuple):
    """What is fused and what is asked."""

    drive: Session
    fused: NDArray[np.int64]
    other: Session
    queries: NDArray[np.int64]
    ground_z: float


def data_of(kind: str, root: str, every: int) -> Data:
    format = KINDS[kind][0]
    sessions = list_sessions(format, root)
    drive = open_session(format, root, sessions[0])
    if len(sessions) > 1:
        other = open_session(format, root, sessions[1])
        asked, fused = np.ones(len(other), dtype=bool), np.arange(len(drive))
    else:
        other, asked = drive, revisits(drive.positions)
        fused = np.flatnonzero(~asked)
    queries = sample_by_distance(other.positions, 5.0, asked)
    near = KDTree(drive.positions[fused]).query(other.positions[queries])[0] <= 10.0
    return Data(drive, fused, other, queries[near][::every], ground_of(drive, format))


def write_fused(data: Data, file: Path) -> None:
    """One PCD file of all scans, double precision, in the world of the poses."""

    def scans() -> Iterator[NDArray[np.float64]]:
        for k in data.fused.tolist():
            points = data.drive.points(k)
            points = points[is_return(points)].astype(np.float64)
            points = points[np.hypot(points[:, 0], points[:, 1]) < FUSED]
            yield moved_points(points, data.drive.poses[k])

    write_pcd(file, scans(), 8)


def ask(place_map: Map, data: Data, seed: int) -> str:
    """The figures of one map, as cells of a table."""
    rng = np.random.default_rng(seed)
    positions = KDTree(place_map.places.positions)
    found, errors, right, trusted = 0, [], [], []
    for k in data.queries.tolist():
        turn = rng.uniform(0, 2 * np.pi)
        seen = place_map.observe([turn_points(data.other.points(k), turn)], data.ground_z)
        first = int(place_map.index.search(seen.descriptors, 1).place[0, 0])
        pose = data.other.poses[k]
        found += first in positions.query_ball_point(pose[:2, 3], 10.0)
        location = place_map.localize_observation(seen)
        away = float(np.hypot(location.x - pose[0, 3], location.y - pose[1, 3]))
        yaw = location.yaw - float(yaw_of(pose[None])[0]) + turn
        off = abs((yaw + np.pi) % (2 * np.pi) - np.pi)
        right.append(away < 2.0 and np.degrees(off) < 5.0)
        trusted.append(location.trusted)
        errors.append((away, np.degrees(off)))
    good, sure = np.array(right), np.array(trusted)
    metres, degrees = np.median(np.array(errors)[good], axis=0) if good.any() else (np.nan, np.nan)
    precision = (good & sure).sum() / max(sure.sum(), 1)
    recall = (good & sure).sum() / max(good.sum(), 1)
    return (
        f"{found / len(good):.3f} | {good.mean():.3f} | {metres:.2f} | {degrees:.2f} | "
        f"{precision:.3f} | {recall:.3f}"
    )


def rows_of(item: str, args: argparse.Namespace) -> Sequence[str]:
    kind, _, root = item.partition("=")
    data, sensor = data_of(kind, root, args.every), KINDS[kind][1]
    network, rows = load_network("shipped").method, []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "fused.pcd"
        write_fused(data, file)
        for path in (data.drive.poses[data.fused, :3, 3], None):
            started = time.perf_counter()
            with open_cloud(file) as cloud:
                built = map_of_cloud(cloud, network, sensor, args.spacing, path)
            seconds = time.perf_counter() - started
            rows.append(
                f"| {Path(root).name}, {'along the path' if path is not None else 'on a grid'} | "
                f"{cloud.points / 1e6:.1f} | {len(built.map)} | {len(data.queries)} | "
                f"{ask(built.map, data, args.seed)} | {seconds:.0f} |"
            )
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="+", metavar="KIND=FOLDER", help=", ".join(KINDS))
    parser.add_argument("--spacing", type=float, help="metres between places")
    parser.add_argument("--every", type=int, default=1, help="take each N-th query")
    parser.add_argument("--seed", type=int, default=0, help="of the turns")
    args = parser.parse_args()
    tune_process()
    torch.set_num_threads(1)
    print(
        "| map of | million points | places | queries | Recall@1 | located | m | ° | precision | "
        "recall | build s |\n| --- |" + " ---: |" * 10
    )
    for item in args.data:
        rows_of(item, args)


if __name__ == "__main__":
    main()
