"""Pairs of scans of two drives: how alike methods find them, and the turn between them.

    python benchmarks/pairs.py drive.yaml map query [--methods ssc scan_context ring] [--count 60]
                               [--checkpoints rinet=FILE overlapnet=FILE] [--way same opposite]

Turns and offsets are of pairs in bands of distance; of turns, errors modulo the method's period.
The pairs of the table of SSC (Li et al. 2021): positive within 3 m, negative beyond 20 m. F1 is the
largest, EP is (P0 + R100) / 2: the precision of the highest score, and the largest recall without
a wrong pair. The paper has 100 negatives for a positive. ``--checkpoints`` are trained networks,
each by the name of its row. ``--way`` takes positives alone in which both drives head the same way,
or opposite ways, to within 45 degrees, and prints F1 and EP alone; with both, how much of F1 is
left where drives head opposite ways.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from deepring.core.rigid import yaw_of
from deepring.data.readers import ground_of, open_session
from deepring.data.session import Session
from deepring.methods.method import Method
from deepring.methods.network_file import load_network
from deepring.methods.registry import method_class
from deepring.methods.ssc import Ssc

BANDS = ((0, 1), (1, 3), (3, 5), (5, 10))
NEAR, FAR = 3.0, 20.0


class Described:
    """A drive's descriptors by one method, each made when it is asked for."""

    def __init__(self, method: Method, session: Session, ground_z: float) -> None:
        self.method, self.session, self.ground_z = method, session, ground_z
        self.made: dict[int, torch.Tensor] = {}

    def __getitem__(self, k: int) -> torch.Tensor:
        """The descriptor (1, ...) of scan ``k``."""
        if k not in self.made:
            raster = self.method.raster
            points = self.session.points(k, raster.columns)
            image = torch.from_numpy(raster(points, self.ground_z))[None]
            self.made[k] = self.method.describe(image)
        return self.made[k]


def pairs_between(
    distance: NDArray[np.float64], low: float, high: float, count: int, rng: np.random.Generator
) -> list[tuple[int, int]]:
    """Up to ``count`` pairs of query and place, each of another query, in a band of distance."""
    pairs = []
    for query in rng.permutation(len(distance)):
        places = np.flatnonzero((distance[query] >= low) & (distance[query] < high))
        if len(places):
            pairs.append((int(query), int(rng.choice(places))))
        if len(pairs) == count:
            break
    return pairs


def f1_and_ep(scores: NDArray[np.float64], right: NDArray[np.bool_]) -> tuple[float, float]:
    """The largest F1 over all thresholds, and (P0 + R100) / 2."""
    order = np.argsort(-scores, kind="stable")
    hits = np.cumsum(right[order])
    precision, recall = hits / np.arange(1, len(hits) + 1), hits / right.sum()
    f1 = 2 * precision * recall / np.maximum(precision + recall, 1e-12)
    return float(f1.max()), float((precision[0] + recall[precision == 1].max(initial=0)) / 2)


def distances(drives: tuple[Session, Session], way: str | None) -> NDArray[np.float64]:
    """Metres (q, p) from each query to each place; NaN where near ones head another ``way``."""
    offsets = drives[1].positions[:, None] - drives[0].positions[None]
    distance = np.hypot(offsets[..., 0], offsets[..., 1])
    if way is not None:
        places, queries = (np.array([yaw_of(pose) for pose in drive.poses]) for drive in drives)
        turn = np.abs((queries[:, None] - places + np.pi) % (2 * np.pi) - np.pi)
        right = turn < np.pi / 4 if way == "same" else turn > 3 * np.pi / 4
        distance[(distance < FAR) & ~right] = np.nan
    return distance


@torch.no_grad()
def measure(
    method: Method,
    drives: tuple[Session, Session],
    ground: float,
    count: int,
    way: str | None = None,
) -> float:
    """Print the rows of one method; its F1."""
    places, queries = (Described(method, drive, ground) for drive in drives)
    distance, rng = distances(drives, way), np.random.default_rng(0)
    period = float(getattr(method, "turn_period", 2 * math.pi))
    for low, high in BANDS if way is None else ():
        errors, ways = [], []
        for query, place in pairs_between(distance, low, high, count, rng):
            turn = method.compare(queries[query], places[place]).turn
            relative = np.linalg.inv(drives[1].poses[query]) @ drives[0].poses[place]
            if turn is not None:
                away = (float(turn) - float(yaw_of(relative)) + period / 2) % period - period / 2
                errors.append(math.degrees(abs(away)))
            if isinstance(method, Ssc):
                found = method.align(queries[query][0], places[place][0]).offset
                ways.append(math.dist(found, relative[:2, 3]))
        text = f"  {low:2d} to {high:2d} m: {len(errors)} pairs"
        if errors:
            within = np.mean(np.array(errors) < 5)
            text += f", turn {np.median(errors):.2f}° in the median, {within:.2f} within 5°"
        print(text + (f", offset {np.median(ways):.2f} m" if ways else ""))
    pairs = pairs_between(distance, 0, NEAR, count, rng)
    positive = len(pairs)
    for _ in range(20):
        pairs += pairs_between(distance, FAR, np.inf, positive, rng)
    scores = np.array([float(method.compare(queries[q], places[p]).score) for q, p in pairs])
    f1, ep = f1_and_ep(scores, np.arange(len(pairs)) < positive)
    means = [part.mean() for part in (scores[:positive], scores[positive:])]
    where = "" if way is None else f"{way} way: "
    print(f"  {where}F1 {f1:.3f}, EP {ep:.3f}: {positive} pairs, {len(pairs) - positive} others")
    print(f"  mean score of these {means[0]:.3f}, of the others {means[1]:.3f}")
    return f1


def methods_of(names: Sequence[str], checkpoints: Sequence[str]) -> Iterator[tuple[str, Method]]:
    """The registered methods, and the networks of ``NAME=FILE``."""
    for name in names:
        made: Any = method_class(name)()
        yield name, made
    for text in checkpoints:
        name, equals, file = text.partition("=")
        if not equals:
            raise SystemExit(f"--checkpoints: {text}, expected NAME=FILE")
        yield name, load_network(file).method


def main(arguments: Sequence[str] | None = None) -> None:
    """Parse, measure each method."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path)
    parser.add_argument("sessions", nargs=2)
    parser.add_argument("--format", default="custom")
    parser.add_argument("--methods", nargs="*", default=["ssc", "scan_context", "ring"])
    parser.add_argument("--checkpoints", nargs="*", default=[], metavar="NAME=FILE")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--way", nargs="+", choices=["same", "opposite"])
    args = parser.parse_args(arguments)
    first, second = (open_session(args.format, args.root, name) for name in args.sessions)
    drives, ground = (first, second), ground_of(first, args.format)
    for name, method in methods_of(args.methods, args.checkpoints):
        print(name)
        f1 = {way: measure(method, drives, ground, args.count, way) for way in args.way or [None]}
        if len(f1) > 1:
            print(f"  left of F1 opposite ways: {f1['opposite'] / f1['same']:.2f}")


if __name__ == "__main__":
    main()
