"""How often a scan from nowhere is trusted, in maps of 1 to 10 000 places, and one from the map.

    python benchmarks/nowhere.py [--seed 300] [--worlds 20] [--scans 1000] [--real FOLDER ...]

Places are 10 m apart along the first drives of simulated campuses and cities, alternately, of the
seeds from ``--seed`` on, odd ones as in `make weights`; each world lies far from the others. A map
of n places is a run of n neighbours along the drives, drawn anew for each scan. Scans from nowhere
are, in equal parts, of further worlds (seeds from ``--seed`` + 60 on), sectors of 70° to 270° of
such scans, indoors, open fields, and random points; real ones are added with ``--real``. Scans from
the map are of the second drives, turned at random, each in maps of the places around it: right is
within 2 m and 5°. All see the map's sensor height. Intervals are exact (Clopper-Pearson, 95 %).

Last come worlds that repeat: a city of equal blocks of which the map holds all, and straight roads
between two walls, where a trusted location is wrong but by chance.
"""

import argparse
import itertools
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from nowhere_scans import (
    RepeatedStreets,
    Road,
    Scan,
    field,
    indoor,
    random_points,
    sector,
    world,
)
from scipy.stats import binomtest

from deepring.core.rigid import wrap_angle, yaw_of
from deepring.data.scans.scan_files import read_scan
from deepring.errors import BrokenScanError
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.localization.observation import Observation, described, occupancy
from deepring.methods.deepring import DeepRing
from deepring.methods.network_file import load_network

SIZES = (1, 2, 3, 10, 100, 1000, 10_000)
LAYOUTS = ("nclt", "mulran")
APART = 10_000.0  # metres between worlds
SECTORS = (270, 180, 120, 90, 70)
#: Formats of real scans whose file names begin so, and z of the ground.
REAL = {"helipr_avia": ("helipr_avia", -1.8), "helipr_aeva": ("helipr_aeva", -1.8)}


class Seen(NamedTuple):
    """Scans as a map sees them, and their poses where they have some."""

    observation: Observation
    poses: np.ndarray


def seen(network: DeepRing, scans: Iterable[tuple[Scan, np.ndarray]]) -> Seen:
    """Images and descriptors of the scans that show anything."""
    raster, parts, poses = Map(network).raster, [], []
    scans = iter(scans)
    while batch := list(itertools.islice(scans, 64)):
        images = []
        for (points, ground_z), pose in batch:
            try:
                images.append(occupancy("scan", points, ground_z, raster))
                poses.append(pose)
            except BrokenScanError:
                continue
        parts.append(described(network, np.stack(images)))
    images, descriptors = zip(*parts, strict=True)
    return Seen(Observation(np.concatenate(images), torch.cat(descriptors)), np.stack(poses))


def worlds(seed: int, count: int, spacing: float, session: int) -> Iterator:
    """Scans of drives through ``count`` worlds, campuses and cities, far from each other."""
    for k in range(count):
        for scan, pose in world(LAYOUTS[k % 2], seed + k // 2, spacing, session):
            pose[0, 3] += APART * k
            yield scan, pose


def from_nowhere(seed: int, count: int) -> dict[str, list[Scan]]:
    """Scans by their kinds, as the module says."""
    rng, part = np.random.default_rng(seed), count // 5
    other = [scan for scan, _ in worlds(seed + 60, 8, 20.0, 0)]
    other = [other[k] for k in rng.permutation(len(other))[: 2 * part]]
    return {
        "other worlds": other[:part],
        "sectors of them": [
            (sector(points, SECTORS[k % 5], rng.uniform(-180, 180)), ground)
            for k, (points, ground) in enumerate(other[part:])
        ],
        "indoors": [indoor(rng, LAYOUTS[k % 2]) for k in range(part)],
        "fields": [field(rng, LAYOUTS[k % 2]) for k in range(part)],
        "random points": [random_points(rng) for _ in range(part)],
    }


def real_scans(folders: list[Path]) -> list[Scan]:
    """The real scans of the folders: NCLT's and HeLiPR's by their names, others as KITTI's."""
    scans = []
    for path in sorted(path for folder in folders for path in folder.glob("*.bin")):
        known = ("nclt", 0.0) if "nclt" in path.parent.name else ("kitti", -1.73)
        known = next((REAL[name] for name in REAL if path.name.startswith(name)), known)
        scans.append((read_scan(path, known[0]), known[1]))
    return scans


def one(scans: Observation, k: int) -> Observation:
    return Observation(scans.images[k : k + 1], scans.descriptors[k : k + 1])


def map_of(network: DeepRing, places: Seen, rows: np.ndarray) -> Map:
    images, descriptors = places.observation
    place_map = Map(network)
    part = Observation(images[rows], descriptors[torch.from_numpy(rows)])
    place_map.add_observation(part, places.poses[rows], [str(k) for k in rows])
    return place_map


def right(location: Location, pose: np.ndarray) -> bool:
    degrees = np.degrees(wrap_angle(location.yaw - float(yaw_of(pose))))
    off = np.hypot(location.x - pose[0, 3], location.y - pose[1, 3])
    return bool(off < 2.0 and abs(degrees) < 5.0)


def share(part: int, whole: int) -> str:
    """A count and the interval of its share."""
    low, high = binomtest(part, max(whole, 1)).proportion_ci(method="exact")
    return f"{part} of {whole} ({low:.4f} to {high:.4f})"


def tabulate(network: DeepRing, places: Seen, kinds: dict[str, Seen], queries: Seen) -> None:
    """Print a row per size of the map."""
    total = sum(len(scans.images) for scans, _ in kinds.values())
    print(
        f"| places | {' | '.join(kinds)} | trusted of all | from the map: right | trusted wrong |"
    )
    print(f"| ---: {'| ---: ' * len(kinds)}| ---: | ---: | ---: |")
    for size in SIZES:
        if size > len(places.poses):
            continue
        maps = Maps(network, places, size)
        trusted = dict.fromkeys(kinds, 0)
        for name, (scans, _) in kinds.items():
            for k in range(len(scans.images)):
                trusted[name] += maps.any().localize_observation(one(scans, k)).trusted
        near = found = wrong = 0
        for k, pose in enumerate(queries.poses):
            place_map = maps.around(pose)
            if place_map is not None:
                location = place_map.localize_observation(one(queries.observation, k))
                near += 1
                found += location.trusted and right(location, pose)
                wrong += location.trusted and not right(location, pose)
        print(
            f"| {size} | {' | '.join(str(v) for v in trusted.values())} | "
            f"{share(sum(trusted.values()), total)} | {found / near:.3f} of {near} | {wrong} |",
            flush=True,
        )


class Maps:
    """Maps of runs of ``size`` places: drawn anew if they are small, else side by side."""

    def __init__(self, network: DeepRing, places: Seen, size: int) -> None:
        self.network, self.places, self.size = network, places, size
        self.rng, count = np.random.default_rng(0), len(places.poses)
        firsts = np.arange(count // size) * size
        self.drawn = size < 1000
        if self.drawn:
            firsts = self.rng.integers(0, count - size + 1, 100)
        self.maps = [self.run(int(first)) for first in firsts]

    def run(self, first: int) -> Map:
        return map_of(self.network, self.places, np.arange(first, first + self.size))

    def any(self) -> Map:
        return self.maps[int(self.rng.integers(len(self.maps)))]

    def around(self, pose: np.ndarray) -> Map | None:
        """A map that holds the place nearest to a pose, if there is one within 10 m."""
        away = np.linalg.norm(self.places.poses[:, :2, 3] - pose[:2, 3], axis=1)
        nearest, last = int(away.argmin()), len(away) - self.size
        if away[nearest] > 10:
            return None
        if self.drawn:
            return self.run(int(np.clip(nearest - self.rng.integers(self.size), 0, last)))
        which = nearest // self.size
        return self.maps[which] if which < len(self.maps) else None


def repeated(network: DeepRing, seed: int) -> None:
    """Print how worlds that repeat are trusted."""
    rng = np.random.default_rng(seed)
    for layout, k in itertools.product(LAYOUTS, range(2)):
        city = RepeatedStreets(layout, seed + k, 4)
        places = seen(network, (city.scan(0, xy, rng) for xy in city.on_streets(10.0)))
        place_map = map_of(network, places, np.arange(len(places.poses)))
        spots = city.on_streets(3.0)[rng.permutation(len(city.on_streets(3.0)))[:100]]
        queries = seen(network, (city.scan(1, xy, rng) for xy in spots))
        say(f"equal blocks, {layout} {seed + k}: {len(place_map)} places", place_map, queries)
    for size in (1, 10):
        for along in (25.0, 200.0):
            total = [0, 0, 0]
            for _ in range(50):
                road = Road(str(rng.choice(LAYOUTS)), rng)
                places = seen(network, (road.scan(10.0 * k, rng) for k in range(size)))
                place_map = map_of(network, places, np.arange(size))
                query = seen(network, [road.scan(10.0 * (size - 1) + along, rng)])
                total = [a + b for a, b in zip(total, judge(place_map, query), strict=True)]
            print(f"roads, {along:g} m beyond a map of {size}: trusted {total[1]} of {total[0]}, "
                  f"wrong {total[2]}")  # fmt: skip


def judge(place_map: Map, queries: Seen) -> tuple[int, int, int]:
    """Queries, how many are trusted, and how many of these are wrong."""
    trusted = wrong = 0
    for k, pose in enumerate(queries.poses):
        location = place_map.localize_observation(one(queries.observation, k))
        trusted += location.trusted
        wrong += location.trusted and not right(location, pose)
    return len(queries.poses), trusted, wrong


def say(name: str, place_map: Map, queries: Seen) -> None:
    total, trusted, wrong = judge(place_map, queries)
    print(f"{name}: trusted {trusted} of {total}, wrong {wrong}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=300)
    parser.add_argument("--worlds", type=int, default=20)
    parser.add_argument("--scans", type=int, default=1000)
    parser.add_argument("--queries", type=float, default=60.0, help="metres between them")
    parser.add_argument("--real", type=Path, nargs="*", default=[], help="folders of .bin files")
    args = parser.parse_args()
    torch.set_num_threads(1)
    started = time.perf_counter()
    network = load_network("shipped").method
    places = seen(network, worlds(args.seed, args.worlds, 10.0, 0))
    queries = seen(network, worlds(args.seed, args.worlds, args.queries, 1))
    nowhere = from_nowhere(args.seed, args.scans)
    if args.real:
        nowhere["real"] = real_scans(args.real)
    kinds = {
        name: seen(network, ((scan, np.eye(4)) for scan in scans))
        for name, scans in nowhere.items()
    }
    print(f"{len(places.poses)} places, {time.perf_counter() - started:.0f} s", flush=True)
    tabulate(network, places, kinds, queries)
    repeated(network, args.seed)


if __name__ == "__main__":
    main()
