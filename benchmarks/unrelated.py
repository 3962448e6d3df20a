"""How well scans of unrelated places fit, and neighbours: one place is all that a scan is put in.

    python benchmarks/unrelated.py sim_nclt=FOLDER sim_nclt=FOLDER sim_mulran=FOLDER [--cells 80]

Unrelated are scans of different worlds of one kind, and scans of one world at least 150 m apart;
neighbours are up to 10 m apart. ``--cells`` leaves each image the given number of cells, those
nearest to a random one: how well images fit that show little. See FEW_CELLS and
FIT_TIMES_ROOT_OF_CELLS in `deepring.localization.location`.
"""

import argparse

import numpy as np
import torch

from deepring.data.readers import ground_of, list_sessions, open_session
from deepring.data.spacing import sample_by_distance
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.localization.observation import Observation
from deepring.methods.network_file import load_network

SCANS, PAIRS = 250, 700


class Scans:
    """Up to `SCANS` scans of the sessions of a dataset, at least 5 m apart in each."""

    def __init__(self, name: str, root: str, place_map: Map) -> None:
        self.kind, images, positions = name, [], []
        format = name.removeprefix("sim_")
        for each in list_sessions(format, root):
            session = open_session(format, root, each)
            every = np.ones(len(session), dtype=np.bool_)
            for k in sample_by_distance(session.positions, 5.0, every):
                images.append(place_map.raster(session.points(k), ground_of(session, format)))
                positions.append(session.positions[k])
        some = np.sort(np.random.default_rng(0).permutation(len(images))[:SCANS])
        self.images, self.positions = np.stack(images)[some], np.stack(positions)[some]

    def pairs(self, other: "Scans", rng: np.random.Generator, near: bool) -> np.ndarray:
        """Pairs (n, 2) of a place here and a scan of the other, near each other or unrelated."""
        away = np.linalg.norm(self.positions[:, None] - other.positions, axis=-1)
        if other is not self:
            away[:] = np.inf
        possible = np.argwhere((away > 0.1) & (away < 10) if near else away > 150)
        return possible[rng.permutation(len(possible))[:PAIRS]]


def heap(image: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """The ``count`` cells nearest to a random one."""
    cells = np.argwhere(image)
    away = np.linalg.norm(cells - cells[rng.integers(len(cells))], axis=1)
    out = np.zeros_like(image)
    out[tuple(cells[np.argsort(away, kind="stable")[:count]].T)] = True
    return out


def located(network, place: np.ndarray, scan: np.ndarray) -> Location:
    """Where a scan is in a map of one place."""
    images = np.stack([place, scan])
    descriptors = network.describe(torch.from_numpy(images)).cpu()
    place_map = Map(network)
    place_map.add_observation(Observation(images[:1], descriptors[:1]), np.eye(4)[None], ["a"])
    return place_map.localize_observation(Observation(images[1:], descriptors[1:]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="+", metavar="DATA=FOLDER")
    parser.add_argument("--cells", type=int, help="cells left of each image")
    args = parser.parse_args()
    torch.set_num_threads(1)
    network, rng = load_network("shipped").method, np.random.default_rng(1)
    worlds = [Scans(*item.split("=", 1), Map(network)) for item in args.data]
    counts = [int(image.sum()) for world in worlds for image in world.images]
    print(f"cells: {min(counts)} to {max(counts)} in {len(counts)} scans")
    for near in (False, True):
        found = []
        for one in worlds:
            for other in worlds:
                if one.kind != other.kind:
                    continue
                for place, scan in one.pairs(other, rng, near):
                    pair = one.images[place], other.images[scan]
                    if args.cells:
                        pair = tuple(heap(image, args.cells, rng) for image in pair)
                    found.append(located(network, *pair))
        fits, trusted = np.array([(one.fit, one.trusted) for one in found]).T
        high = ", ".join(f"{q:g} % up to {np.percentile(fits, q):.3f}" for q in (50, 90, 99, 100))
        print(f"{'neighbours' if near else 'unrelated'}: {len(fits)} pairs, {high}; ", end="")
        print(f"trusted {trusted.sum():.0f}, {trusted.mean():.4f}", flush=True)


if __name__ == "__main__":
    main()
