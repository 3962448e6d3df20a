"""A map of places, in which scans are located."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch

from deepring import checks
from deepring.core.rigid import yaw_after_turn
from deepring.errors import ConfigError, DataError
from deepring.io.sealed import open_sealed, write_sealed
from deepring.localization.candidate_search import search_candidates
from deepring.localization.candidates import RerankSettings, align_candidates
from deepring.localization.given import given_list, given_names, given_path, given_poses
from deepring.localization.location import AcceptanceThresholds, Location, best_fit, ratio_of
from deepring.localization.map_file import (
    FORMAT,
    SEARCH,
    MapHeader,
    expect_fitting,
    prefixed,
    under,
)
from deepring.localization.observation import Observation, described, observed, occupancy
from deepring.localization.place_points import PlacePoints, given_points
from deepring.localization.place_store import PlaceStore
from deepring.localization.refined_pose import RefinedPose, refined_pose
from deepring.localization.registration.refinement import RefinementSettings
from deepring.localization.rivals import fit_elsewhere
from deepring.methods.deepring import DeepRing
from deepring.methods.network_file import describe_network, make_network, weights_of
from deepring.rasters import BevRaster
from deepring.search.correlation_index import CorrelationIndex
from deepring.search.search_settings import SearchSettings

#: Scans described at a time.
BATCH = 64


class Map:
    """Places with their descriptors, images and poses, and the network that describes them.

    The network travels in the map, so that a scan is always described as the places were.

    Args:
        network: DeepRING over images from above, compared by correlation.
        ground_z: z of the ground under the sensor in the scans' frame, metres.
        search: how descriptors are stored and looked up.
        rerank: how candidates are selected and aligned.
        thresholds: when a location is trusted.
        points: whether the map keeps each place's points too, thinned; see `PlacePoints`.

    Raises ConfigError for another network, for a ``ground_z`` that is not a finite number, and for
    settings of other types.
    """

    def __init__(
        self,
        network: DeepRing,
        ground_z: float = 0.0,
        search: SearchSettings | None = None,
        rerank: RerankSettings | None = None,
        thresholds: AcceptanceThresholds | None = None,
        points: bool = False,
    ) -> None:
        checks.of_type("network", network, DeepRing)
        checks.of_type("points", points, bool)
        for name, value, kind in (
            ("search", search, SearchSettings),
            ("rerank", rerank, RerankSettings),
            ("thresholds", thresholds, AcceptanceThresholds),
        ):
            if value is not None:
                checks.of_type(name, value, kind)
        index = network.index(search or SEARCH)
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
        self.points = PlacePoints() if points else None
        self.source = ""
        """What the places were built from, in words; empty if nobody says."""
        self.doubts: tuple[str, ...] = ()
        """What was doubtful about that, in words, such as poses that scans contradict."""

    def __len__(self) -> int:
        return len(self.places)

    def add(self, scans: Iterable[Any], poses: Any, names: Iterable[str]) -> None:
        """Add k places: scans (n, 3), each in its own frame, and poses (k, 4, 4), world <- scan.

        Arrays, tensors and lists of numbers are taken. Raises DataError as `observe` does, and
        unless there is one rigid pose and one name per scan; the map then stays as it was.
        """
        scans = given_list("scans", scans, "scans (n, 3)")
        poses, names = given_poses(poses, len(scans)), given_names(names, len(scans))
        self.add_observation(self.observe(scans), poses, names, scans)

    def localize(
        self, points: Any, before: int | None = None, ground_z: float | None = None
    ) -> Location:
        """Locate a scan (n, 3), metres in its own frame: an array, a tensor or lists of numbers.

        ``before`` leaves out that place and all added after it. ``ground_z`` is z of the ground
        in the scan's frame, for a sensor at another height than the map's. Raises DataError
        if no place is left, and as `observe` does.
        """
        self._expect_places(before)
        return self.localize_observation(self.observe([points], ground_z), before)

    def refine(
        self,
        points: Any,
        location: Location,
        ground_z: float | None = None,
        settings: RefinementSettings | None = None,
    ) -> RefinedPose:
        """The whole pose of a scan that was located, with its covariance, by the map's points.

        The scan's points (n, 3) are registered on those of the location's place and the places
        around. A location that is not trusted is refined too, and stays a doubt.

        Args:
            points: the scan, as in `localize`.
            location: what `localize` gave.
            ground_z: see `localize`.
            settings: the registration.

        Raises DataError for a map without points (``Map(points=True)``) and as `localize` does for
        a scan, and ConfigError if small_gicp is not installed.
        """
        checks.of_type("location", location, Location)
        return refined_pose(self, points, location, ground_z, settings or RefinementSettings())

    def observe(self, scans: Iterable[Any], ground_z: float | None = None) -> Observation:
        """Images and descriptors of scans, for `add_observation` and `localize_observation`.

        Missing returns (NaN, infinite, (0, 0, 0)) are dropped. Raises DataError for what is not
        like an array (n, 3) of real numbers, and BrokenScanError, also a DataError, for a scan
        without points and one of which less than `LEAST_CELLS` cells stand out of the ground.
        """
        if ground_z is None:
            ground_z = self.ground_z
        checks.number("ground_z", ground_z, "metres")
        scans = given_list("scans", scans, "scans (n, 3)")
        names = ["scan"] if len(scans) == 1 else [f"scans[{k}]" for k in range(len(scans))]
        images = np.empty((len(scans), *self.raster.shape), dtype=np.bool_)
        for k, (name, scan) in enumerate(zip(names, scans, strict=True)):
            images[k] = occupancy(name, scan, ground_z, self.raster)
        return described(self.network, images)

    def add_observation(
        self,
        scans: Observation,
        poses: Any,
        names: Iterable[str],
        points: Iterable[Any] | None = None,
    ) -> None:
        """Add k places, as `add` does, from what `observe` gives.

        ``points`` are the scans themselves, for a map that keeps points; another needs none.
        Raises DataError as `add` does.
        """
        scans = self._observed(scans)
        count = len(scans.images)
        poses, names = given_poses(poses, count), given_names(names, count)
        thinned = [] if self.points is None else given_points(points, count)
        with self.all_or_nothing():
            self.places.add(scans.images, poses, names)
            self.index.add(scans.descriptors)
            if self.points is not None:
                self.points.add(thinned)

    @contextmanager
    def all_or_nothing(self) -> Iterator[None]:
        """Take back all places that are added inside if it ends in an error or with Ctrl-C."""
        every: tuple[Any, ...] = (self.places, self.index, self.points)
        parts = [part for part in every if part is not None]
        marks = [part.mark() for part in parts]
        try:
            yield
        except BaseException:
            for part, mark in zip(parts, marks, strict=True):
                part.rewind(mark)
            raise

    def localize_observation(self, scan: Observation, before: int | None = None) -> Location:
        """Locate one scan, as `localize` does, from what `observe` gives."""
        self._expect_places(before)
        if len(self._observed(scan).images) != 1:
            raise DataError(f"observation: {len(scan.images)} scans, expected one")
        places, poses, turns, scores = search_candidates(
            self.index, self.places, scan.descriptors, self.rerank, before
        )
        image, images = torch.from_numpy(scan.images[0]), self.places.images(places)
        alignment = align_candidates(image, turns, images, self.rerank, poses)
        best = best_fit(alignment, poses, self.rerank)
        candidate = best.candidate
        found, turn = images[candidate], float(alignment.turn[candidate])
        position = alignment.position[candidate]
        rival = max(best.rival, fit_elsewhere(image, found, turn, position, self.rerank))
        ratio = ratio_of(best.fit, rival)
        cells = min(int(image.sum()), int(found.sum()))
        doubt = self.thresholds.doubt(best.fit, ratio, cells)
        return Location(
            place=int(places[candidate]),
            name=self.places.names[int(places[candidate])],
            x=float(best.position[0]),
            y=float(best.position[1]),
            yaw=yaw_after_turn(float(poses[candidate, 2]), turn),
            similarity=float(scores[candidate]),
            fit=best.fit,
            ratio=ratio,
            cells=cells,
            trusted=doubt is None,
            doubt=doubt,
        )

    def _expect_places(self, before: int | None) -> None:
        if before is not None:
            checks.count("before", before, 0)
        if not len(self) or before == 0:
            raise DataError("map: holds no places to compare with; expected at least one; add some")

    def _observed(self, scans: Observation) -> Observation:
        if self.index.shape is not None:
            return observed(scans, self.raster.shape, self.index.shape)
        # The network tells what an empty map will hold.
        blank = np.zeros((1, *self.raster.shape), dtype=np.bool_)
        shape = described(self.network, blank).descriptors.shape[1:]
        return observed(scans, self.raster.shape, tuple(shape))

    def save(self, path: Path | str) -> None:
        """Write the map, whole or not at all. A map that is there is replaced."""
        path = given_path(path)
        code = self.index.code
        tensors = self.places.tensors() | prefixed("index.", self.index.tensors())
        tensors |= prefixed("network.", weights_of(self.network))
        if code is not None:
            tensors |= {"code.basis": code.basis, "code.step": code.step}
        if self.points is not None:
            tensors |= self.points.tensors()
        header = MapHeader(
            network=describe_network(self.network),
            ground_z=self.ground_z,
            search=self.index.settings,
            rerank=self.rerank,
            thresholds=self.thresholds,
            shape=self.index.shape,
            names=tuple(self.places.names),
            source=self.source,
            doubts=self.doubts,
        )
        write_sealed(path, FORMAT, header, tensors)

    @classmethod
    def open(cls, path: Path | str, *, check: bool = False) -> "Map":
        """Open what `save` wrote, memory-mapped; ``check`` reads every byte first.

        Raises FileError for a file that is missing, not a map, cut short, altered, or of another
        version.
        """
        file = open_sealed(given_path(path), FORMAT, check=check)
        header, tensors = file.header, file.tensors
        with file.contents():
            network = make_network(header.network, under("network.", tensors))
            if not isinstance(network, DeepRing):
                raise ConfigError(f"network: {network.settings.label}, expected DeepRING")
            settings = (header.search, header.rerank, header.thresholds)
            place_map = cls(network, header.ground_z, *settings)
            expect_fitting(network, header)
            place_map.source, place_map.doubts = header.source, header.doubts
            place_map.places.restore(tensors["images"], tensors["poses"], header.names)
            place_map.points = PlacePoints.restored(tensors, len(place_map))
            rows, code = under("index.", tensors), under("code.", tensors)
            place_map.index.restore(rows, header.shape, code.get("basis"), code.get("step"))
            if len(place_map.index) != len(place_map):
                raise DataError(
                    f"index: {len(place_map.index)} places, expected {len(place_map)}, one per name"
                )
        return place_map
