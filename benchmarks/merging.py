"""Maps put together: how well one map's frame is found in another, and which are refused.

    python benchmarks/merging.py sim_nclt=FOLDER sim_mulran=FOLDER kitti=FOLDER [--seed 0]

Database and queries of each dataset's test region (the whole drive where it has none) become a map
each, with places at the dataset's spacings. The second one is in a random frame of its own (seed).
Each first map is also tried with the second maps of all other datasets, where nothing is right.
"""

import argparse
import math
import time

import numpy as np

from deepring.core.rigid import pose_from, rotation_from_rpy, yaw_of
from deepring.data.scan_set import ScanSet
from deepring.errors import DataError
from deepring.localization.map import Map
from deepring.localization.map_merge import find_frame
from deepring.methods.network_file import load_network
from localization import map_of, retrieval


def map_in(scans: ScanSet, network, pose: np.ndarray) -> Map:
    """A map of the scans in the frame of ``pose``, world <- frame."""
    place_map = Map(network, scans.ground_z)
    for k in scans.indices.tolist():
        here = np.linalg.inv(pose) @ scans.session.poses[k : k + 1]
        place_map.add([scans.session.points(k)], here, [str(k)])
    return place_map


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("datasets", nargs="+", metavar="DATA=FOLDER")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    network, rng = load_network("shipped").method, np.random.default_rng(args.seed)
    maps = []
    for text in args.datasets:
        name, _, root = text.partition("=")
        scans = retrieval(name, root, None, False)
        pose = pose_from(
            rotation_from_rpy(0, 0, rng.uniform(-math.pi, math.pi)), rng.uniform(-500, 500, 3)
        )
        maps.append(
            (text, map_of(scans.database, network, 360.0), map_in(scans.query, network, pose), pose)
        )
    print("| maps | places | found | agree | off m | off ° | s |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    refused = wrong = 0
    for k, (text, first, _, _) in enumerate(maps):
        for other, (_, _, second, pose) in enumerate(maps):
            start = time.perf_counter()
            try:
                frame = find_frame(first, second)
            except DataError as error:
                refused += other != k
                if other == k:
                    print(f"| {text} | {len(first)} + {len(second)} | refused: {error} |")
                continue
            wrong += other != k
            if other == k:
                middle = second.places.positions.mean(axis=0)
                point = np.array([*middle, 0, 1])
                off = float(np.linalg.norm(((frame.pose - pose) @ point)[:2]))
                turn = abs(float(yaw_of(frame.pose[:3, :3] @ pose[:3, :3].T)))
                print(
                    f"| {text} | {len(first)} + {len(second)} | {frame.located} of {frame.tried} "
                    f"| {frame.agreeing} | {off:.2f} | {math.degrees(turn):.3f} "
                    f"| {time.perf_counter() - start:.1f} |"
                )
    print(f"maps of different worlds: {refused} of {refused + wrong} refused")


if __name__ == "__main__":
    main()
