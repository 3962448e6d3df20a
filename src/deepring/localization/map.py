"""A map of places, and where a scan was taken in it."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.core.rigid import yaw_after_turn, yaw_of
from deepring.data.cache import Progress, Rasters, pack
from deepring.data.session import Session
from deepring.data.spacing import sample_by_distance
from deepring.errors import DeepringError
from deepring.localization.alignment import AlignmentSettings
from deepring.localization.candidates import (
    Located,
    RerankSettings,
    align_candidates,
    by_location,
    spread_out,
)
from deepring.localization.map_file import read_map, verify, write_map
from deepring.methods.deepring import DeepRing
from deepring.methods.index_for import index_for
from deepring.methods.portable import describe_network, make_network, weights_of
from deepring.rasters.kinds import BevRaster
from deepring.search.block_store import axis_of
from deepring.search.code import CodeSettings
from deepring.search.correlation_index import CorrelationIndex, SearchSettings

#: Places looked up for each candidate that is aligned, so that candidates can lie apart.
SURPLUS = 8

#: Scans described at a time.
BATCH = 64


@dataclass(frozen=True)
class AcceptanceThresholds:
    """When a location is to be trusted: both have to be reached.

    The usual thresholds trust 99.8 % right locations where half of the scans are nowhere in the
    map, on simulated worlds of their own (`make weights`).
    """

    fit: float = 0.21
    """Of the alignment, at most 1."""
    ratio: float = 1.41
    """Of the fit to the best one that puts the scan elsewhere."""

    def holds(self, located: Located) -> bool:
        """Whether to trust it."""
        return located.fit >= self.fit and located.ratio >= self.ratio


@dataclass(frozen=True)
class Location:
    """Where a scan was taken."""

    place: int
    """The map's place that it was found by."""
    name: str
    """That place's scan."""
    x: float
    """Metres, in the world of the map's poses."""
    y: float
    yaw: float
    """Heading in the world, radians in [-π, π)."""
    similarity: float
    """Of the descriptors, higher is more alike."""
    fit: float
    """Of the alignment, at most 1."""
    ratio: float
    """Of the fit to the best one that puts the scan elsewhere; infinite without any."""
    trusted: bool


class Map:
    """Places with their descriptors, images and poses, and the network that describes them.

    The network travels in the map, so that a scan is always described as the places were.

    Args:
        network: DeepRING over images from above, compared by correlation.
        ground_z: z of the ground under the sensor in the scans' frame, metres.
        search: how descriptors are kept and looked up.
        rerank: how candidates are aligned.
        trust: when a location is trusted.
    """

    def __init__(
        self,
        network: DeepRing,
        ground_z: float = 0.0,
        search: SearchSettings | None = None,
        rerank: RerankSettings | None = None,
        trust: AcceptanceThresholds | None = None,
    ) -> None:
        index = index_for(network, search or SearchSettings("int8"))
        raster = network.raster
        if not isinstance(index, CorrelationIndex) or not isinstance(raster, BevRaster):
            raise DeepringError(
                f"map: {network.settings.label} over a {type(raster).__name__}, compared by "
                f"{network.settings.similarity.kind}; expected a BevRaster and correlation"
            )
        self.network, self.raster, self.index = network.eval(), raster, index
        self.ground_z = ground_z
        self.rerank = rerank or RerankSettings()
        self.trust = trust or AcceptanceThresholds()
        self.images = torch.empty(0, -(-(raster.cells**2) // 8), dtype=torch.uint8)
        self.poses = torch.empty(0, 4, 4, dtype=torch.float64)
        self.names: list[str] = []

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def build(
        cls,
        session: Session,
        network: DeepRing,
        spacing: float = 10.0,
        ground_z: float = 0.0,
        progress: Progress | None = None,
        **settings: Any,
    ) -> "Map":
        """A map of a session's scans, one every ``spacing`` metres. ``settings`` as for `Map`."""
        built = cls(network, ground_z, **settings)
        everywhere = np.ones(len(session.files), dtype=np.bool_)
        chosen = sample_by_distance(session.positions, spacing, everywhere)
        for start in range(0, len(chosen), BATCH):
            some = chosen[start : start + BATCH]
            scans = [session.points(int(k)) for k in some]
            built.add(scans, session.poses[some], [session.files[k].name for k in some])
            if progress is not None:
                progress(start + len(some), len(chosen))
        return built

    def add(
        self, scans: list[NDArray[np.float32]], poses: NDArray[np.float64], names: list[str]
    ) -> None:
        """Add places: scans (n, 3) each in their own frames, poses (k, 4, 4) world <- scan."""
        rasters = np.stack([self._draw(scan) for scan in scans])
        self.index.add(self.network.describe(torch.from_numpy(rasters)).cpu())
        packed = np.stack([pack(raster, self.raster) for raster in rasters])
        self.images = torch.cat([self.images, torch.from_numpy(packed)])
        self.poses = torch.cat([self.poses, torch.from_numpy(np.asarray(poses, np.float64))])
        self.names += names

    def localize(
        self,
        points: NDArray[np.float32],
        before: int | None = None,
        ground_z: float | None = None,
    ) -> Location:
        """Where a scan (n, 3), metres in its own frame, was taken.

        ``before`` leaves out that place and those added after it. ``ground_z`` is z of the ground
        in the scan's frame, for a sensor at another height than the map's. Raises DeepringError
        where no place is left, and for a scan without points or with numbers that are none.
        """
        if not len(self) or (before is not None and before < 1):
            raise DeepringError("map: holds no places to look among; expected at least one")
        raster = torch.from_numpy(self._draw(points, ground_z))
        described = self.network.describe(raster[None]).cpu()
        hits = self.index.search(described, SURPLUS * self.rerank.candidates, before=before)
        assert hits.turn is not None
        some = spread_out(self.poses[hits.place[0], :2, 3], self.rerank)
        place, turn, similarity = hits.place[0, some], hits.turn[0, some], hits.score[0, some]
        maps = Rasters(self.images.numpy(), self.raster)[place.numpy()]
        candidates = align_candidates(raster, place, turn, maps, self.rerank)
        poses = self._planar(place)
        located = by_location(candidates, poses, self.rerank)
        k = located.candidate
        return Location(
            place=int(place[k]),
            name=self.names[int(place[k])],
            x=float(located.position[0]),
            y=float(located.position[1]),
            yaw=yaw_after_turn(float(poses[k, 2]), float(candidates.aligned.turn[k])),
            similarity=float(similarity[k]),
            fit=located.fit,
            ratio=located.ratio,
            trusted=self.trust.holds(located),
        )

    def save(self, path: Path | str) -> None:
        """Write the map, whole or not at all."""
        blocks = self.index.places.blocks()
        names = list(blocks[0]) if blocks else []
        tensors = {
            f"index.{name}": torch.cat([block[name] for block in blocks], dim=axis_of(name))
            for name in names
        }
        if self.index.code is not None:
            tensors |= {"code.basis": self.index.code.basis, "code.step": self.index.code.step}
        tensors |= {f"network.{name}": value for name, value in weights_of(self.network).items()}
        tensors |= {"images": self.images, "poses": self.poses}
        header = {
            "network": describe_network(self.network),
            "ground_z": self.ground_z,
            "search": asdict(self.index.settings),
            "rerank": asdict(self.rerank),
            "trust": asdict(self.trust),
            "shape": self.index.shape,
            "names": self.names,
        }
        write_map(Path(path), header, tensors)

    @classmethod
    def open(cls, path: Path | str, *, check: bool = False) -> "Map":
        """Open what `save` wrote, memory-mapped; ``check`` reads every byte first.

        Raises DeepringError for a file that is missing, no map, cut short, altered, or of another
        version.
        """
        path = Path(path)
        header, tensors = read_map(path)
        if check:
            verify(path, header, tensors)
        network = make_network(header["network"], _under("network.", tensors))
        if not isinstance(network, DeepRing):
            raise DeepringError(f"map {path}: of {network.settings.label}, expected DeepRING")
        search = dict(header["search"])
        code = search.pop("code")
        settings = SearchSettings(code=None if code is None else CodeSettings(**code), **search)
        rerank = dict(header["rerank"])
        alignment = AlignmentSettings(**rerank.pop("alignment"))
        aligned = RerankSettings(alignment=alignment, **rerank)
        opened = cls(
            network, header["ground_z"], settings, aligned, AcceptanceThresholds(**header["trust"])
        )
        opened.names = list(header["names"])
        opened.images, opened.poses = tensors["images"], tensors["poses"]
        rows = _under("index.", tensors)
        if rows:
            basis, step = tensors.get("code.basis"), tensors.get("code.step")
            opened.index.restore(rows, header["shape"], basis, step)
        return opened

    def _draw(
        self, points: NDArray[np.float32], ground_z: float | None = None
    ) -> NDArray[np.bool_]:
        return self.raster(expect_scan(points), self.ground_z if ground_z is None else ground_z)

    def _planar(self, place: Tensor) -> Tensor:
        """x, y and heading of places (k, 3)."""
        poses = self.poses[place]
        heading = torch.from_numpy(yaw_of(poses.numpy()))
        return torch.column_stack([poses[:, :2, 3], heading])


def expect_scan(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """The points as they are. Raises DeepringError for none, and for numbers that are none."""
    if points.ndim != 2 or points.shape[1] < 3 or not len(points):
        raise DeepringError(f"scan: shape {points.shape}, expected (n, 3) with at least one point")
    bad = int((~np.isfinite(points[:, :3])).any(axis=1).sum())
    if bad:
        raise DeepringError(
            f"scan: {bad} of {len(points)} points have coordinates that are no numbers; drop them"
        )
    return points


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {
        name.removeprefix(prefix): tensor
        for name, tensor in tensors.items()
        if name.startswith(prefix)
    }
