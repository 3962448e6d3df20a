"""Narrow sensors in a map, with and without scans joined by odometry.

    python benchmarks/accumulation.py [--seed 320] [--worlds 4] [--samples FOLDER --kitti FOLDER]

Maps hold whole scans every 10 m of the first drives through simulated campuses and cities, odd
seeds as in `make weights`. Queries are of the second drives: sectors of scans 1 m apart, forward,
each with up to N - 1 before it, joined by odometry (`deepring localize --accumulate N`). Found is
within 2 m and 5°; queries are at most 10 m from a place.

``--samples`` are HeLiPR's scans of an Aeva (120°) and an Avia (70°): those of one drive among 300
of KITTI as the map, each other one turned four ways as the query. The Avia's are also joined.
"""

import argparse
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from nowhere_scans import sector, settings_of

from deepring.core.rigid import turn_points, wrap_angle, yaw_of
from deepring.data.readers.kitti import open_kitti
from deepring.data.scans.point_times import TimedPoints
from deepring.data.scans.scan_files import read_scan
from deepring.errors import BrokenScanError
from deepring.localization.accumulation import Accumulator
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.methods.network_file import load_network
from deepring.simulation.scene import Scene

LAYOUTS, SECTORS, COUNTS = ("nclt", "mulran"), (360, 120, 90, 70), (1, 5, 10)
#: Azimuth of the vehicle's front in the sensor's frame, degrees.
FRONT = {"nclt": 0.0, "mulran": 180.0}


def drive(scene: Scene, session: int, every: float, length: int) -> Iterator:
    """Runs of ``length`` scans and the pose (4, 4) of the last of each, ``every`` metres."""
    poses = scene.drives[session].poses(scene.drives[session].scan_stamps)
    step = max(1, round(every / scene.settings.scan_spacing))
    for last in range(length - 1, len(poses), step):
        scans = []
        for k in range(last - length + 1, last + 1):
            sweep = scene.sweep(session, k)
            scans.append(sweep.points[sweep.valid].astype(np.float32))
        yield scans, poses[last] @ scene.sensors[session].mount


def right(location: Location, pose: np.ndarray) -> bool:
    degrees = np.degrees(wrap_angle(location.yaw - float(yaw_of(pose))))
    off = np.hypot(location.x - pose[0, 3], location.y - pose[1, 3])
    return bool(off < 2.0 and abs(degrees) < 5.0)


def simulated(seed: int, worlds: int, network) -> None:
    rows = {(width, count): [0, 0, 0, 0] for width in SECTORS for count in COUNTS}
    for k in range(worlds):
        layout = LAYOUTS[k % 2]
        usual = settings_of(layout, seed + k // 2)
        # A sensor that looks ahead has no blind sector there.
        scene = Scene(replace(usual, scan_spacing=1.0, blind_width_deg=0.0))
        place_map = Map(network, -scene.sensors[0].height)
        for (points,), pose in drive(scene, 0, 10.0, 1):
            place_map.add([points], pose[None], ["place"])
        for scans, pose in drive(scene, 1, 160.0, max(COUNTS)):
            away = np.linalg.norm(place_map.places.positions - pose[:2, 3], axis=1)
            if away.min() <= 10:
                judge(scans, pose, FRONT[layout], place_map, rows)
    print("| sector | scans joined | queries | found | trusted | trusted wrong |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: |")
    for (width, count), (total, found, trusted, wrong) in rows.items():
        shares = f"{found / total:.3f} | {trusted / total:.3f}"
        print(f"| {width}° | {count} | {total} | {shares} | {wrong} |", flush=True)


def judge(scans: list, pose: np.ndarray, front: float, place_map: Map, rows: dict) -> None:
    for width, count in rows:
        accumulator = Accumulator(count)
        joined = deque(
            (
                accumulator.join(TimedPoints(sector(scan, width, front), None))
                for scan in scans[-count:]
            ),
            maxlen=1,
        )
        row = rows[width, count]
        row[0] += 1
        try:
            location = place_map.localize(joined[0])
        except BrokenScanError:
            continue
        row[1] += right(location, pose)
        row[2] += location.trusted
        row[3] += location.trusted and not right(location, pose)


def real(samples: Path, kitti: Path, network) -> None:
    session = open_kitti(kitti)
    for name, ground in (("avia", -1.8), ("aeva", -1.8)):
        files = sorted(samples.glob(f"helipr_{name}_*.bin"))
        scans = {path.stem[-2:]: read_scan(path, f"helipr_{name}") for path in files}
        if name == "avia":
            accumulator = Accumulator(2)
            accumulator.join(TimedPoints(scans["00"], None))
            scans["00+01"] = accumulator.join(TimedPoints(scans["01"], None))
        for place, query in (
            (a, b) for a in scans for b in scans if not set(a.split("+")) & set(b.split("+"))
        ):
            place_map = Map(network, -1.73)
            rows = np.linspace(0, len(session) - 1, 300).astype(int)
            for k in rows:
                place_map.add([session.points(k)], session.poses[k : k + 1], ["kitti"])
            seen = place_map.observe([scans[place]], ground)
            pose = np.eye(4)
            pose[0, 3] = 1e5
            place_map.add_observation(seen, pose[None], [name])
            found = [
                place_map.localize(turn_points(scans[query], turn), ground_z=ground)
                for turn in (0.0, 1.7, 3.3, 5.0)
            ]
            print(
                f"{name}, {place} in the map, {query} sought: found "
                f"{sum(one.name == name for one in found)}, trusted "
                f"{sum(one.trusted for one in found)}, wrong "
                f"{sum(one.trusted and one.name != name for one in found)} of 4; fit "
                f"{', '.join(f'{one.fit:.2f}' for one in found)}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=320)
    parser.add_argument("--worlds", type=int, default=4)
    parser.add_argument("--samples", type=Path, help="folder of HeLiPR's scans")
    parser.add_argument("--kitti", type=Path, help="a KITTI sequence")
    args = parser.parse_args()
    torch.set_num_threads(1)
    network = load_network("shipped").method
    if args.samples:
        real(args.samples, args.kitti, network)
    if args.worlds:
        simulated(args.seed, args.worlds, network)


if __name__ == "__main__":
    main()
