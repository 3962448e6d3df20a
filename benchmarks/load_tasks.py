"""What `load.py` measures, each task in a process of its own."""

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scenes import outline, scan

from deepring.data.inspection.poses import pose_findings
from deepring.data.inspection.session import inspect
from deepring.data.readers import open_session
from deepring.data.scans.scan_files import read_scan
from deepring.data.session import Session
from deepring.localization.map import BATCH, Map
from deepring.localization.observation import Observation
from deepring.methods.network_file import load_network

#: Places that are drawn and described; a map repeats them with noise.
DRAWN = 1000
#: Places after which the time of growing is taken.
STEP = 10_000
#: Poses for each scan of a session: NCLT has some 100 a second, and five scans.
POSES_PER_SCAN = 28


@dataclass(frozen=True)
class Size:
    """How much there is of everything."""

    places: int = 200_000
    scans: int = 28_000
    points: int = 1_000_000


@dataclass(frozen=True)
class Figure:
    """One measurement."""

    what: str
    n: int
    """Places, scans or points that it was measured over."""
    seconds: float
    megabytes: float
    """The most memory that the process has had up to then, memory-mapped pages included."""


def peak_megabytes() -> float:
    """The most memory that this process has had."""
    status = Path("/proc/self/status")
    if status.is_file():
        for line in status.read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1000
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000


def figure(what: str, n: int, function: Callable[[], object]) -> tuple[Figure, object]:
    """What a call takes, and what it gives."""
    start = time.perf_counter()
    found = function()
    return Figure(what, n, time.perf_counter() - start, peak_megabytes()), found


def street(rng: np.random.Generator) -> np.ndarray:
    """Points (n, 3) of a place as `outline` draws it, on its ground."""
    ground = np.column_stack([rng.uniform(-60, 60, (3000, 2)), np.zeros(3000)])
    return np.concatenate([outline(rng) + np.float32([0, 0, 1]), ground]).astype(np.float32)


def grow(folder: Path, size: Size) -> Iterator[Figure]:
    """A map that grows to its full size, and is saved."""
    network = load_network("shipped").method
    place_map = Map(network)
    rng = np.random.default_rng(0)
    scans = [street(rng) for _ in range(min(DRAWN, size.places))]
    np.save(folder / "place.npy", scans[0])
    drawn = np.stack([place_map.raster(points, 0.0) for points in scans])
    described = torch.cat([network.describe(part) for part in torch.from_numpy(drawn).split(BATCH)])
    generator = torch.Generator().manual_seed(0)
    spread = 0.1 * described.std()
    seconds = 0.0
    for start in range(0, size.places, BATCH):
        numbers = np.arange(start, min(start + BATCH, size.places))
        rows = numbers % len(drawn)
        descriptors = described[rows]
        if start:
            descriptors = descriptors + spread * torch.randn(descriptors.shape, generator=generator)
        seen = Observation(drawn[rows], descriptors)
        poses = np.tile(np.eye(4), (len(numbers), 1, 1))
        poses[:, 0, 3], poses[:, 1, 3] = 10.0 * (numbers % 1000), 10.0 * (numbers // 1000)
        names = [f"{number:06}.npy" for number in numbers]
        began = time.perf_counter()
        place_map.add_observation(seen, poses, names)
        seconds += time.perf_counter() - began
        if (len(place_map) // STEP) > (start // STEP) or len(place_map) == size.places:
            yield Figure("10 000 places more", len(place_map), seconds, peak_megabytes())
            seconds = 0.0
    yield figure("save a map", size.places, lambda: place_map.save(folder / "load.map"))[0]


def locate(folder: Path, size: Size) -> Iterator[Figure]:
    """That map opened, and one scan located in it."""
    points = np.load(folder / "place.npy")
    opened, place_map = figure("open a map", size.places, lambda: Map.open(folder / "load.map"))
    yield opened

    def call() -> object:
        return place_map.localize(points)

    first, location = figure("locate the first scan", size.places, call)
    assert location.place % DRAWN == 0, location  # or one of its repeats, whose images are the same
    yield first
    seconds = [figure("locate a scan", size.places, call)[0].seconds for _ in range(10)]
    yield Figure("locate a scan", size.places, float(np.median(seconds)), peak_megabytes())


def verify(folder: Path, size: Size) -> Iterator[Figure]:
    """That map opened with every byte checked, as `deepring localize` opens it."""
    yield figure(
        "open a map, all bytes checked",
        size.places,
        lambda: Map.open(folder / "load.map", check=True),
    )[0]


def write_session(root: Path, scans: int) -> None:
    """A drive in NCLT's layout along a street, with eight small scans linked again and again."""
    lidar = root / "2031-01-01" / "velodyne_sync"
    lidar.mkdir(parents=True)
    hit = np.dtype([("xyz", "<u2", (3,)), ("intensity", "u1"), ("laser", "u1")])
    originals = []
    for k in range(8):
        points = scan(1000, seed=k) - np.float32([0, 0, 1.8])
        records = np.zeros(len(points), hit)
        records["xyz"] = np.round((points * [1, -1, -1] + 100) / 0.005).clip(1, 65535)
        originals.append(root / f"{k}.bin")
        records.tofile(originals[-1])
    stamps = 1_900_000_000_000_000 + 200_000 * np.arange(scans, dtype=np.int64)
    for k, stamp in enumerate(stamps):
        os.link(originals[k % 8], lidar / f"{stamp}.bin")
    rows = POSES_PER_SCAN * scans
    seconds = np.linspace(0, 0.2 * scans, rows)
    angle = seconds / 300
    table = np.column_stack(
        [
            stamps[0] + np.round(seconds * 1e6),
            400 * np.sin(angle),
            400 * (1 - np.cos(angle)),
            *np.zeros((3, rows)),
            angle % (2 * np.pi),
        ]
    )
    with (root / "2031-01-01" / "groundtruth_2031-01-01.csv").open("w", encoding="utf-8") as file:
        np.savetxt(file, table, fmt="%d,%.4f,%.4f,%.4f,%.6f,%.6f,%.6f")


def session(folder: Path, size: Size) -> Iterator[Figure]:
    """A long session opened, and the part of `deepring data check` that other commands run."""
    if not (folder / "nclt").is_dir():
        write_session(folder / "nclt", size.scans)
    opened, drive = figure(
        "open a session", size.scans, lambda: open_session("nclt", folder / "nclt", "2031-01-01")
    )
    assert isinstance(drive, Session)
    assert len(drive) >= size.scans - 1
    yield opened
    yield figure("check its poses", size.scans, lambda: pose_findings(drive))[0]
    yield figure("inspect it", size.scans, lambda: inspect(drive, -1.8))[0]


def dense(folder: Path, size: Size) -> Iterator[Figure]:
    """A scan of very many points: read, described and located."""
    network = load_network("shipped").method
    place_map = Map(network)
    np.save(folder / "dense.npy", scan(size.points))
    for k in range(8):
        pose = np.eye(4)[None]
        pose[0, 0, 3] = 20.0 * k
        place_map.add([scan(20_000, seed=k)], pose, [str(k)])
    read, points = figure("read a scan", size.points, lambda: read_scan(folder / "dense.npy"))
    yield read
    network.describe(torch.from_numpy(place_map.raster(points, 0.0))[None])  # compiles
    yield figure("draw it from above", size.points, lambda: place_map.raster(points, 0.0))[0]
    yield figure("describe it", size.points, lambda: place_map.observe([points]))[0]
    place_map.localize(points)
    yield figure("locate it", size.points, lambda: place_map.localize(points))[0]


TASKS: dict[str, Callable[[Path, Size], Iterator[Figure]]] = {
    "grow": grow,
    "locate": locate,
    "verify": verify,
    "session": session,
    "dense": dense,
}
