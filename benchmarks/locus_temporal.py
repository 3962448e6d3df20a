"""What Locus's pooling over time is worth: places and queries described with the scans before them.

    python benchmarks/locus_temporal.py sim_nclt FOLDER CHECKPOINT [--radius 10]

Places and queries are those of the evaluation of a dataset's test region (conf/data/NAME.yaml).
Each is described alone, and with the three scans of its drive before it and their true poses, as
published. Printed is Recall@1 with its 95 % interval.
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from deepring.data.dataset import distances_between
from deepring.data.scan_set import ScanSet
from deepring.evaluation.intervals import wilson
from deepring.evaluation.metrics import recall_at_k
from deepring.methods.locus import Locus
from deepring.methods.locus.temporal import describe_drive
from deepring.methods.network_file import load_network
from localization import retrieval

#: Scans before each that are pooled over.
PREVIOUS = 3


def described(method: Locus, scans: ScanSet) -> tuple[torch.Tensor, torch.Tensor]:
    """Descriptors (n, values) of scans alone, and with the scans before them."""
    session, alone, over_time = scans.session, [], []
    for index in scans.indices:
        numbers = np.arange(max(0, index - PREVIOUS), index + 1)
        images = [method.raster(session.points(int(k)), scans.ground_z) for k in numbers]
        rasters = torch.from_numpy(np.stack(images))
        alone.append(method.describe(rasters[-1:]))
        drive = describe_drive(method, rasters, session.poses[numbers], scans.ground_z, PREVIOUS)
        over_time.append(drive[-1:])
    return torch.cat(alone), torch.cat(over_time)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", help="of conf/data/NAME.yaml")
    parser.add_argument("root", help="the dataset's folder")
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--radius", type=float, default=10.0)
    args = parser.parse_args()
    method = load_network(args.checkpoint).method
    assert isinstance(method, Locus), "expected a checkpoint of method=locus"
    split = retrieval(args.name, args.root, None, False)
    steps = [np.diff(s.session.positions, axis=0) for s in (split.database, split.query)]
    apart = np.median(np.hypot(*np.concatenate(steps).T))
    distances = distances_between(split.query.positions, split.database)
    answerable = int((distances.amin(dim=1) <= args.radius).sum())
    print(f"{len(split.database)} places, {answerable} answerable queries")
    print(f"{apart:.1f} m from scan to scan")
    places, queries = described(method, split.database), described(method, split.query)
    for name, p, q in zip(("alone", "over time"), places, queries, strict=True):
        recall = float(recall_at_k(method.compare(q, p).score, distances, 1, args.radius))
        low, high = wilson(recall, answerable)
        print(f"{name}: Recall@1 {recall:.3f} ({low:.2f}-{high:.2f})")


if __name__ == "__main__":
    main()
