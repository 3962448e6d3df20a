"""How well pairs of scans are aligned, by distance: of two sessions, or of one with itself.

    python benchmarks/poses.py nclt outputs/datasets/sim_nclt [--pairs 120] [--refine]

Success is less than 2 m and 5° from the relative pose of the session's poses. The turn is given as
descriptors of 60 rows give it, rounded to 6°, and its opposite beside it. --refine adds rows
of the same pairs refined on their points: their time is that of refinement alone, and the last
column the share that it did not give up.
"""

import argparse
import itertools
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import torch

from deepring.core.rigid import yaw_after_turn, yaw_of
from deepring.data.readers import ground_of, list_sessions, open_session, reader_names
from deepring.data.session import Session
from deepring.localization.alignment import Alignment, align
from deepring.localization.alignment.image_correlation import half_whitened, occupied_cells
from deepring.localization.alignment.settings import AlignmentSettings
from deepring.localization.registration.refinement import refine
from deepring.rasters import BevRaster

BINS = ((0, 10), (10, 20), (20, 35))

#: Scans of one session this close in driving order are no revisit.
APART = 60


@dataclass
class Row:
    """What is measured at one distance."""

    name: str
    errors: list[float] = field(default_factory=list)
    turns: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    settled: list[bool] = field(default_factory=list)

    def add(self, turn: float, position, relative, seconds: float, settled: bool = True) -> None:
        off = (turn - turn_of(relative) + math.pi) % (2 * math.pi) - math.pi
        self.errors.append(float(np.linalg.norm(position - relative[:2, 3])))
        self.turns.append(abs(math.degrees(off)))
        self.seconds.append(seconds)
        self.settled.append(settled)

    def show(self) -> None:
        errors, turns = np.array(self.errors), np.array(self.turns)
        good = (errors < 2) & (turns < 5)
        shift, turn = (np.median(v[good]) if good.any() else math.nan for v in (errors, turns))
        print(
            f"| {self.name} | {len(good)} | {good.mean():.3f} | {shift:.2f} | {turn:.2f} | "
            f"{np.median(self.seconds) * 1e3:.1f} | {np.mean(self.settled):.3f} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("format", choices=reader_names())
    parser.add_argument("root")
    parser.add_argument("--pairs", type=int, default=120)
    parser.add_argument("--refine", action="store_true", help="on the points, too")
    args = parser.parse_args()
    torch.set_num_threads(1)
    names = list_sessions(args.format, args.root)
    drives = [open_session(args.format, args.root, name) for name in names[:2]]
    first, second = drives[0], drives[-1]
    raster, rng = BevRaster(), np.random.default_rng(0)
    ground_z = ground_of(first, args.format)
    print("| metres | pairs | success | median m | median ° | ms | settled |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for low, high in BINS:
        aligned, refined = Row(f"{low} to {high}"), Row(f"{low} to {high}, refined")
        for j, k in itertools.islice(pairs(first, second, low, high, rng), args.pairs):
            relative = np.linalg.inv(first.poses[j]) @ second.poses[k]
            place, query = first.points(j), second.points(k)
            images = [torch.from_numpy(raster(points, ground_z)) for points in (place, query)]
            started = time.perf_counter()
            found = aligned_pair(*images, turn_of(relative))
            took = time.perf_counter() - started
            turn, position = float(found.turn), found.position[0].numpy()
            aligned.add(turn, position, relative, took)
            if args.refine:
                started = time.perf_counter()
                better = refine(query, place, turn, position)
                took = time.perf_counter() - started
                refined.add(better.turn, better.position, relative, took, better.converged)
        aligned.show()
        if args.refine:
            refined.show()


def pairs(
    first: Session, second: Session, low: float, high: float, rng: np.random.Generator
) -> Iterator[tuple[int, int]]:
    """A scan of the first for each of the second, from ``low`` to ``high`` metres away."""
    for k in rng.permutation(len(second.files)):
        away = np.linalg.norm(first.positions - second.positions[k], axis=1)
        near = np.flatnonzero((away >= low) & (away < high))
        if first is second:
            near = near[np.abs(near - k) > APART]
        if len(near):
            yield int(rng.choice(near)), int(k)


def turn_of(relative: np.ndarray) -> float:
    """Points turn the other way than the sensor."""
    return yaw_after_turn(0.0, float(yaw_of(relative)))


def aligned_pair(place: torch.Tensor, query: torch.Tensor, truth: float) -> Alignment:
    step = math.radians(6)
    known = round(truth / step) * step
    tried = torch.tensor([[known, known + math.pi]], dtype=torch.float32)
    settings = AlignmentSettings()
    spectrum = half_whitened(place[None], settings)
    return align(occupied_cells(query, settings), spectrum, tried, settings)


if __name__ == "__main__":
    main()
