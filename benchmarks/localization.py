"""How scans of one drive are located in a map of another, and when to trust it.

    python benchmarks/localization.py sim_nclt=outputs/datasets/sim_nclt_seed0 \\
      sim_mulran=outputs/datasets/sim_mulran_seed0 kitti=FOLDER [--blind 90] [--calibrate 0.99]

Each DATA=FOLDER is a file of conf/data: its test region (the whole drive where it has none), its
two sessions or a drive's first passes and revisits, its spacings. Right is within 2 m and 5°.
--blind takes a sector of each query away, at a random angle. --sector leaves one of each query,
as a sensor of that field of view has: forward, or with --sideways at a random angle; --map-sector
leaves one of each place, forward. The usual thresholds are judged. "Alone" is
the first stage, the descriptors: Recall@1 within 10 m, over the queries near a place.
--calibrate prints those that reach a precision on all of them together and as many scans that are
nowhere in the map: each dataset's queries in the map of another one of its kind.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from omegaconf import OmegaConf

from deepring.core.rigid import pose_from, rotation_from_rpy, turn_points, yaw_after_turn
from deepring.data.dataset import DatasetConfig, PlaceDataset, RetrievalSet
from deepring.data.scan_set import ScanSet
from deepring.errors import BrokenScanError
from deepring.localization.calibration import (
    LocalizationTrials,
    Tolerance,
    calibrate,
    concatenate,
    evaluate_thresholds,
    run_trials,
)
from deepring.localization.location import AcceptanceThresholds
from deepring.localization.map import Map
from deepring.methods.network_file import load_network

CONF = Path(__file__).parents[1] / "conf" / "data"


def retrieval(name: str, root: str, spacing: float | None, whole: bool) -> RetrievalSet:
    config = OmegaConf.merge(
        OmegaConf.structured(DatasetConfig),
        OmegaConf.load(CONF / f"{name}.yaml"),
        {"root": root},
        {} if spacing is None else {"spacing": {"database": spacing}},
    )
    dataset = PlaceDataset(OmegaConf.to_object(config))
    whole = whole or config.regions.test is None
    return dataset.retrieval("whole" if whole else "test")


def map_of(scans: ScanSet, network, sector: float) -> Map:
    place_map = Map(network, scans.ground_z)
    for k in scans.indices.tolist():
        points = seen(scans.session.points(k), sector, 0.0)
        try:
            place_map.add([points], scans.session.poses[k : k + 1], [str(k)])
        except BrokenScanError as error:
            print(f"left out: {error}")
    return place_map


def seen(points: np.ndarray, sector: float, middle: float) -> np.ndarray:
    """The points in a field of view of ``sector`` degrees around the azimuth ``middle``."""
    away = np.degrees(np.arctan2(points[:, 1], points[:, 0])) - middle
    return points[np.abs((away + 180) % 360 - 180) <= sector / 2]


def queries(scans: ScanSet, sector: float, sideways: bool, seed: int) -> Iterator:
    """Scans and their poses; turned, where the dataset says so, after the sector is cut."""
    rng = np.random.default_rng(seed)
    turns = np.zeros(len(scans)) if scans.turns is None else scans.turns
    for k, turn in zip(scans.indices.tolist(), turns, strict=True):
        middle = rng.uniform(-180, 180) if sideways else 0.0
        points = seen(scans.session.points(k), sector, middle)
        yaw = yaw_after_turn(0.0, float(turn))
        sensor = pose_from(rotation_from_rpy(0, 0, yaw), np.zeros(3))
        yield turn_points(points, float(turn)), scans.session.poses[k] @ sensor


def first_stage(place_map: Map, scans: list) -> float:
    """Recall@1 of descriptors alone within 10 m, over the scans near a place."""
    every = torch.arange(len(place_map))
    places = place_map.places.planar_poses(every)[:, :2].numpy()
    right = []
    for points, pose in scans:
        away = np.linalg.norm(places - pose[:2, 3], axis=1)
        if away.min() <= 10:
            hits = place_map.index.search(place_map.observe([points]).descriptors, 1)
            right.append(away[int(hits.place[0, 0])] <= 10)
    return float(np.mean(right))


def elsewhere(maps: list[tuple[str, Map, list]]) -> Iterator[LocalizationTrials]:
    """Queries looked up where they cannot be right, in the map of the next dataset of the kind."""
    for k, (name, _, scans) in enumerate(maps):
        other = next((m for n, m, _ in [*maps[k + 1 :], *maps[:k]] if n == name), None)
        if other is not None:
            far = run_trials(other, scans)
            nowhere = np.full(len(far.fit), np.inf)
            yield far._replace(metres=nowhere, degrees=nowhere, nearest=nowhere)


def row(
    name: str,
    trials: LocalizationTrials,
    thresholds: AcceptanceThresholds,
    seconds: float,
    alone: float = float("nan"),
) -> str:
    right, near = trials.correct(Tolerance()), trials.nearest <= 10
    calibration = evaluate_thresholds(trials, thresholds)
    place = trials.metres[near] < 10
    return (
        f"| {name} | {len(right)} | {alone:.3f} | {np.mean(place):.3f} | "
        f"{np.mean(right[near][place]):.3f} | "
        f"{np.median(trials.metres[right]):.2f} | {np.median(trials.degrees[right]):.2f} | "
        f"{calibration.precision:.3f} | {calibration.recall:.3f} | {seconds * 1e3:.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="+", metavar="DATA=FOLDER")
    parser.add_argument("--checkpoint", default="shipped")
    parser.add_argument("--spacing", type=float, help="metres between map places")
    parser.add_argument("--whole", action="store_true", help="drives and not test regions")
    parser.add_argument("--blind", type=float, default=0.0, help="degrees, at a random angle")
    parser.add_argument("--sector", type=float, default=360.0, help="degrees left of a query")
    parser.add_argument("--sideways", action="store_true", help="the sector at a random angle")
    parser.add_argument("--map-sector", type=float, default=360.0, help="degrees left of a place")
    parser.add_argument("--every", type=int, default=1, help="take each N-th query")
    parser.add_argument("--calibrate", type=float, metavar="PRECISION")
    parser.add_argument("--seed", type=int, default=0, help="of the blind sectors")
    args = parser.parse_args()
    torch.set_num_threads(1)
    network = load_network(args.checkpoint).method
    print("| | queries | alone | within 10 m | of them right | m | ° | precision | recall | ms |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    sector, sideways = min(args.sector, 360 - args.blind), args.sideways or args.blind > 0
    every, maps = [], []
    for item in args.data:
        name, _, root = item.partition("=")
        split = retrieval(name, root, args.spacing, args.whole)
        place_map = map_of(split.database, network, args.map_sector)
        scans = list(queries(split.query, sector, sideways, args.seed))[:: args.every]
        maps.append((name, place_map, scans))
        place_map.localize(scans[0][0])  # compiles
        started = time.perf_counter()
        every.append(run_trials(place_map, scans))
        seconds = (time.perf_counter() - started) / len(scans)
        alone = first_stage(place_map, scans)
        print(row(Path(root).name, every[-1], AcceptanceThresholds(), seconds, alone), flush=True)
    if args.calibrate:
        print(calibrate(concatenate([*every, *elsewhere(maps)]), args.calibrate))


if __name__ == "__main__":
    main()
