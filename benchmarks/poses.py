"""How well pairs of scans are aligned, by distance: of two sessions, or of one with itself.

    python benchmarks/poses.py nclt outputs/datasets/sim_nclt [--pairs 120] [--rows]

Success is less than 2 m and 5° from the relative pose of the session's poses. The yaw is given as
descriptors of 60 rows give it, rounded to 6°, and its opposite beside it.
"""

import argparse
import math
import time

import numpy as np
import torch

from deepring.core.alignment import AlignmentSettings, align, half_whitened, occupied_cells
from deepring.core.radon import radon
from deepring.core.rasters import BevRaster
from deepring.core.rigid import yaw_of
from deepring.core.row_alignment import align_rows
from deepring.data.formats import FORMATS, ground_of, list_sessions, open_session

BINS = ((0, 10), (10, 20), (20, 35))

#: Scans of one session this close in driving order are no revisit.
APART = 60


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("format", choices=list(FORMATS))
    parser.add_argument("root")
    parser.add_argument("--pairs", type=int, default=120)
    parser.add_argument("--rows", action="store_true", help="by rows of the sinograms")
    args = parser.parse_args()
    torch.set_num_threads(1)
    names = list_sessions(args.format, args.root)
    drives = [open_session(args.format, args.root, name) for name in names[:2]]
    first, second = drives[0], drives[-1]
    settings, raster, rng = AlignmentSettings(), BevRaster(), np.random.default_rng(0)

    def image(session, k: int) -> torch.Tensor:
        return torch.from_numpy(raster(session.points(int(k)), ground_of(session, args.format)))

    print("| metres | pairs | success | median m | median ° | ms |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    for low, high in BINS:
        errors, turns, seconds = [], [], []
        for k in rng.permutation(len(second.files)):
            away = np.linalg.norm(first.positions - second.positions[k], axis=1)
            near = np.flatnonzero((away >= low) & (away < high))
            if len(drives) == 1:
                near = near[np.abs(near - k) > APART]
            if not len(near):
                continue
            j = rng.choice(near)
            relative = np.linalg.inv(first.poses[j]) @ second.poses[k]
            truth = -float(yaw_of(relative))  # points turn the other way than the sensor
            step = math.radians(6)
            known = round(truth / step) * step
            tried = torch.tensor([[known, known + math.pi]], dtype=torch.float32)
            query, place = image(second, k), image(first, j)
            started = time.perf_counter()
            if args.rows:
                found = align_rows(radon(query), radon(place)[None], tried)
            else:
                spectrum = half_whitened(place[None], settings)
                found = align(occupied_cells(query, settings), spectrum, tried, settings)
            seconds.append(time.perf_counter() - started)
            errors.append(float(np.linalg.norm(found.position[0].numpy() - relative[:2, 3])))
            off = (float(found.yaw) - truth + math.pi) % (2 * math.pi) - math.pi
            turns.append(abs(math.degrees(off)))
            if len(errors) == args.pairs:
                break
        good = (np.array(errors) < 2) & (np.array(turns) < 5)
        shift, turn = (
            np.median(np.array(v)[good]) if good.any() else math.nan for v in (errors, turns)
        )
        print(
            f"| {low} to {high} | {len(good)} | {good.mean():.3f} | {shift:.2f} | {turn:.2f} | "
            f"{np.median(seconds) * 1e3:.1f} |"
        )


if __name__ == "__main__":
    main()
