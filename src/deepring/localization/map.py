"""A map of places, in which scans are located."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.core.rigid import yaw_after_turn
from deepring.data.session import Session
from deepring.data.spacing import sample_by_distance
from deepring.errors import ConfigError, DataError
from deepring.io.sealed import open_sealed, write_sealed
from deepring.localization.candidates import RerankSettings, align_candidates, spread_out
from deepring.localization.location import AcceptanceThresholds, Location, best_fit
from deepring.localization.map_file import FORMAT, MapHeader, expect_fitting, prefixed, under
from deepring.localization.place_store import PlaceStore
from deepring.localization.scan_points import expect_scan
from deepring.methods.deepring import DeepRing
from deepring.methods.network_file import describe_network, make_network, weights_of
from deepring.progress import Progress
from deepring.rasters import BevRaster
from deepring.search.block_store import axis_of
from deepring.search.correlation_index import CorrelationIndex, SearchSettings

#: Places looked up per candidate, so that enough of them lie apart.
SURPLUS = 8

#: Scans described at a time.
BATCH = 64


class Observation(NamedTuple):
    """Images and descriptors of k scans."""

    images: NDArray[np.bool_]
    """(k, n, n) occupancy from above."""
    descriptors: Tensor
    """(k, θ, ω) float32, on the CPU."""


class Map:
    """Places with their descriptors, images and poses, and the network that describes them.

    The network travels in the map, so that a scan is always described as the places were.

    Args:
        network: DeepRING over images from above, compared by correlation.
        ground_z: z of the ground under the sensor in the scans' frame, metres.
        search: how descriptors are stored and looked up.
        rerank: how candidates are selected and aligned.
        thresholds: when a location is trusted.

    Raises ConfigError for another network, and for a ``ground_z`` that is not a finite number.
    """

    def __init__(
        self,
        network: DeepRing,
        ground_z: float = 0.0,
        search: SearchSettings | None = None,
        rerank: RerankSettings | None = None,
        thresholds: AcceptanceThresholds | None = None,
    ) -> None:
        index = network.index(search or SearchSettings("int8"))
        raster = network.raster
        if not isinstance(index, CorrelationIndex) or not isinstance(raster, BevRaster):
            raise ConfigError(
                f"network: {network.settings.label} over a {type(raster).__name__}, compared by "
                f"{network.settings.similarity.kind}; expected a BevRaster and correlation"
            )
        self.network, self.raster, self.index = network.eval(), raster, index
        self.ground_z = checks.number("ground_z", ground_z, "metres")
        self.rerank = rerank or RerankSettings()
        self.thresholds = thresholds or AcceptanceThresholds()
        self.places = PlaceStore(raster)

    def __len__(self) -> int:
        return len(self.places)

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
        """A map of a session, one place per ``spacing`` metres; ``settings`` are those of `Map`."""
        place_map = cls(network, ground_z, **settings)
        everywhere = np.ones(len(session.files), dtype=np.bool_)
        selection = sample_by_distance(session.positions, spacing, everywhere)
        for start in range(0, len(selection), BATCH):
            batch = selection[start : start + BATCH]
            scans = [session.points(int(k)) for k in batch]
            place_map.add(scans, session.poses[batch], [session.files[k].name for k in batch])
            if progress is not None:
                progress(start + len(batch), len(selection))
        return place_map

    def add(
        self, scans: Sequence[NDArray[np.float32]], poses: NDArray[np.float64], names: Sequence[str]
    ) -> None:
        """Add k places: scans (n, 3), each in its own frame, and poses (k, 4, 4), world <- scan.

        Raises DataError as `observe` does, and unless there is one pose and one name per scan.
        """
        self.add_observation(self.observe(scans), poses, names)

    def localize(
        self,
        points: NDArray[np.float32],
        before: int | None = None,
        ground_z: float | None = None,
    ) -> Location:
        """Locate a scan (n, 3), metres in its own frame.

        ``before`` leaves out that place and all added after it. ``ground_z`` is z of the ground
        in the scan's frame, for a sensor at another height than the map's. Raises DataError
        if no place is left, and as `observe` does.
        """
        return self.localize_observation(self.observe([points], ground_z), before)

    def observe(
        self, scans: Sequence[NDArray[np.float32]], ground_z: float | None = None
    ) -> Observation:
        """Images and descriptors of scans, for `add_observation` and `localize_observation`.

        Raises DataError for a scan without points, and for coordinates that are not finite.
        """
        ground_z = self.ground_z if ground_z is None else ground_z
        images = np.stack([self.raster(expect_scan("scan", scan), ground_z) for scan in scans])
        return Observation(images, self.network.describe(torch.from_numpy(images)).cpu())

    def add_observation(
        self, scans: Observation, poses: NDArray[np.float64], names: Sequence[str]
    ) -> None:
        """Add k places, as `add` does, from what `observe` gives."""
        self.places.add(scans.images, poses, names)
        self.index.add(scans.descriptors)

    def localize_observation(self, scan: Observation, before: int | None = None) -> Location:
        """Locate one scan, as `localize` does, from what `observe` gives."""
        if not len(self) or (before is not None and before < 1):
            raise DataError("map: holds no places to compare with; expected at least one; add some")
        k = SURPLUS * self.rerank.candidates
        hits = self.index.search(scan.descriptors, k, before=before)
        assert hits.turn is not None
        poses = self.places.planar_poses(hits.place[0])
        rows = spread_out(poses[:, :2], self.rerank)
        places, poses = hits.place[0, rows], poses[rows]
        alignment = align_candidates(
            torch.from_numpy(scan.images[0]),
            hits.turn[0, rows],
            self.places.images(places),
            self.rerank,
        )
        best = best_fit(alignment, poses, self.rerank)
        candidate = best.candidate
        return Location(
            place=int(places[candidate]),
            name=self.places.names[int(places[candidate])],
            x=float(best.position[0]),
            y=float(best.position[1]),
            yaw=yaw_after_turn(float(poses[candidate, 2]), float(alignment.turn[candidate])),
            similarity=float(hits.score[0, rows[candidate]]),
            fit=best.fit,
            ratio=best.ratio,
            trusted=bool(self.thresholds.accept(best.fit, best.ratio)),
        )

    def save(self, path: Path | str) -> None:
        """Write the map, whole or not at all."""
        blocks = self.index.places.blocks()
        rows = {
            name: torch.cat([block[name] for block in blocks], dim=axis_of(name))
            for name in (blocks[0] if blocks else ())
        }
        code = self.index.code
        tensors = self.places.tensors() | prefixed("index.", rows)
        tensors |= prefixed("network.", weights_of(self.network))
        if code is not None:
            tensors |= {"code.basis": code.basis, "code.step": code.step}
        header = MapHeader(
            network=describe_network(self.network),
            ground_z=self.ground_z,
            search=self.index.settings,
            rerank=self.rerank,
            thresholds=self.thresholds,
            shape=self.index.shape,
            names=tuple(self.places.names),
        )
        write_sealed(path, FORMAT, header, tensors)

    @classmethod
    def open(cls, path: Path | str, *, check: bool = False) -> "Map":
        """Open what `save` wrote, memory-mapped; ``check`` reads every byte first.

        Raises FileError for a file that is missing, not a map, cut short, altered, or of another
        version.
        """
        file = open_sealed(path, FORMAT, check=check)
        header, tensors = file.header, file.tensors
        with file.contents():
            network = make_network(header.network, under("network.", tensors))
            if not isinstance(network, DeepRing):
                raise ConfigError(f"network: {network.settings.label}, expected DeepRING")
            settings = (header.search, header.rerank, header.thresholds)
            place_map = cls(network, header.ground_z, *settings)
            expect_fitting(network, header)
            place_map.places.restore(tensors["images"], tensors["poses"], header.names)
            rows, code = under("index.", tensors), under("code.", tensors)
            place_map.index.restore(rows, header.shape, code.get("basis"), code.get("step"))
            if len(place_map.index) != len(place_map):
                raise DataError(
                    f"index: {len(place_map.index)} places, expected {len(place_map)}, one per name"
                )
        return place_map
