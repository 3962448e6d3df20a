"""Map by one sensor (rows), query by another (columns): Recall@1 within 10 m on a simulated world.

    python benchmarks/sensors.py -o FOLDER [--checkpoint FILE] [--only vlp16 os1_64] [KNOB=VALUE]

Simulates two drives for each sensor, all through the same world and along the same paths, into
FOLDER/SENSOR, and describes each scan once per method: the network (the package's own unless
``--checkpoint`` names another) and RING. Map places are 20 m apart, queries 5 m, and count if a
place is within 10 m. Beside each recall is Wilson's 95 % interval. A query that cannot be described
is a miss. Knobs are those of `deepring simulate custom`: ``query_`` knobs change the queries' side.

A table's row is printed as soon as it is known, and FOLDER/NAME.csv has all cells so far; what was
simulated and rasterized stays in FOLDER, so that a run that was interrupted goes on. The default
world is small, with some 300 queries; nine sensors take 6 GB, and some ten minutes on one core.
"""

import argparse
import logging
from pathlib import Path

import numpy as np
import torch
from peer_table import Share

from deepring.cli.simulate_command import parse_knob
from deepring.data.cache import RasterCache, load_rasters
from deepring.data.readers import open_session
from deepring.data.scan_set import ScanSet
from deepring.data.spacing import sample_by_distance
from deepring.errors import ConfigError, DataError
from deepring.evaluation.look_up import fill_index, look_up
from deepring.io.files import replacing
from deepring.methods.method import Method, describe_all
from deepring.methods.network_file import load_network
from deepring.methods.ring import Ring
from deepring.progress import progress_bar
from deepring.simulation.presets import custom, with_knobs
from deepring.simulation.sensor_models import SENSORS
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.simulate import session_names, simulate

RADIUS = 10.0
SPACINGS = (20.0, 5.0)  # metres between map places, and between queries

#: A world of two by three blocks on either side of the gap; every fifth metre is scanned.
SMALL = {"train_columns": 2, "test_columns": 3, "rows": 3, "scan_spacing": 2.5}


class Side:
    """The scans of one session by one sensor, and their descriptors by each method."""

    def __init__(self, root: Path, number: int, settings: SimulationSettings) -> None:
        session = open_session("custom", root / "drive.yaml", session_names(settings)[number])
        every = np.ones(len(session), dtype=np.bool_)
        chosen = sample_by_distance(session.positions, SPACINGS[number], every)
        self.scans = ScanSet(session, chosen, session.ground_z)
        self.title = f"{settings.sensor}, {session.name}"

    def described(self, method: Method, cache: RasterCache) -> tuple[ScanSet, torch.Tensor] | None:
        """The scans that show something and their descriptors; None if hardly any does."""
        try:
            seen, rasters = load_rasters(cache, self.scans, method.raster, self.title)
        except DataError as problem:
            print(f"  {self.title}: left out: {problem}")
            return None
        return seen, describe_all(method, rasters)


def recall(method: Method, places: Side, queries: Side, cells: dict) -> Share:
    """Right first places among the queries with a place within `RADIUS`."""
    known, scans = cells[places], cells[queries]
    if known is None or scans is None:
        return Share(0, 0)
    answerable = nearest(queries.scans, places.scans).min(axis=1) <= RADIUS
    hits, _ = look_up(fill_index(method, [known[1]]), [scans[1]], 1)
    first = hits.place[:, 0].numpy()
    away = nearest(scans[0], known[0])[np.arange(len(first)), first]
    within = np.isin(scans[0].indices, queries.scans.indices[answerable])
    return Share(int((away[within] <= RADIUS).sum()), int(answerable.sum()))


def nearest(queries: ScanSet, places: ScanSet) -> np.ndarray:
    """Distances (q, d) in metres."""
    return np.linalg.norm(queries.positions[:, None] - places.positions, axis=-1)


def table(name: str, method: Method, sides: dict, cache: RasterCache, folder: Path) -> None:
    """Print Recall@1 of each pair of sensors, and write it to ``folder``/``name``.csv."""
    cells = {side: side.described(method, cache) for pair in sides.values() for side in pair}
    print(f"\n{name}, map by (rows), query by (columns), Recall@1 within {RADIUS:g} m\n")
    print(f"| | {' | '.join(sides)} |\n| --- |{' ---: |' * len(sides)}", flush=True)
    lines = ["map,query,recall,low,high,answerable"]
    for mapped, (places, _) in sides.items():
        shares = [recall(method, places, queries, cells) for _, queries in sides.values()]
        print(f"| {mapped} | {' | '.join(map(str, shares))} |", flush=True)
        for asked, share in zip(sides, shares, strict=True):
            low, high = share.interval
            value = share.good / share.of if share.of else float("nan")
            lines.append(f"{mapped},{asked},{value!r},{low!r},{high!r},{share.of}")
        with replacing(folder / f"{name.lower()}.csv") as path:
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--checkpoint", default="shipped", help="network (%(default)s)")
    parser.add_argument("--only", nargs="+", choices=SENSORS, default=list(SENSORS))
    parser.add_argument("--seed", type=int, default=200, help="seed of the world (%(default)s)")
    parser.add_argument("--workers", type=int, default=1, help="processes (%(default)s)")
    parser.add_argument("knobs", nargs="*", metavar="KNOB=VALUE")
    args = parser.parse_intermixed_args(arguments)
    logging.basicConfig(level=logging.ERROR)
    torch.set_num_threads(1)
    knobs = SMALL | dict(parse_knob(text) for text in args.knobs)
    if knobs.keys() & {"sensor", "query_sensor"}:
        raise ConfigError("sensor: a knob of the rows and columns; choose sensors with --only")
    network = load_network(args.checkpoint).method
    sides = {}
    for sensor in args.only:
        settings = with_knobs(custom(args.seed), knobs | {"sensor": sensor})
        with progress_bar(f"simulating {sensor}") as bar:
            root = simulate(settings, args.output / sensor, workers=args.workers, progress=bar)
        sides[sensor] = (Side(root, 0, settings), Side(root, 1, settings))
    cache = RasterCache(args.output / "rasters", workers=1)
    for name, method in (("DeepRING", network), (Ring.label, Ring())):
        table(name, method, sides, cache, args.output)


if __name__ == "__main__":
    main()
