"""DH3D (Du, Wang, Cremers, ECCV 2020): local descriptors, a detector and the place, in stages."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float, Float64
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError
from deepring.methods.dh3d.dh3d_network import Detector, LocalEncoder, PlaceHead
from deepring.methods.dh3d.keypoints import Keypoints, consensus, mutual_matches, strongest
from deepring.methods.dh3d.point_graph import point_graph
from deepring.methods.network import PlainSettings
from deepring.methods.vector_network import VectorNetwork
from deepring.rasters import PointsRaster, raster_settings

#: Scans whose local descriptors are made at once.
_AT_ONCE = 16


class LocalPoints(NamedTuple):
    """The points of b scans, each described by its surroundings."""

    points: Float[Tensor, "batch n 3"]
    """Metres."""
    descriptors: Float[Tensor, "batch n d"]
    """Of unit norm."""
    scores: Float[Tensor, "batch n"]
    """In (0, 1): how far a point can be relied on."""


@dataclass(frozen=True)
class Dh3dSettings(PlainSettings):
    """Everything that makes a descriptor but the weights. Plain values, kept in checkpoints."""

    label: ClassVar[str] = "DH3D"

    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(PointsRaster(8192)))
    neighbours: int = 8  # points nearest to each, which a convolution sees
    thinning: int = 8  # one point in so many makes the coarse cloud
    stem: int = 32  # channels of the first layer
    first: int = 64  # channels of the first stage, on all points
    second: int = 128  # of the second stage, on the coarse cloud
    gates: Sequence[int] = (16, 32)  # hidden channels of each stage's gate
    local: int = 128  # length of a local descriptor
    detector: Sequence[int] = (128, 256, 1024)  # widths of the layers that score points
    features: int = 256  # of a point, for the place
    attention: int = 1024  # hidden width of the layer that weighs points
    clusters: int = 64  # of NetVLAD
    dimension: int = 256  # length of a descriptor
    gating: bool = True  # weighs a descriptor's values by one another
    keypoints: int = 512  # of a scan, for a pose
    apart: float = 0.5  # metres that keypoints keep from each other
    reach: float = 0.5  # metres that a matched point may be off
    agreeing: int = 10  # matches that have to agree on a pose


class Dh3d(VectorNetwork):
    """Points (b, n, 3) -> local features of each -> a descriptor of the scan at unit norm.

    Its parts are trained in stages: `local`, `detector`, then `place`. The order of the points
    changes nothing but ties; a turn of the scan does, since offsets are seen in its frame.
    """

    settings_class = Dh3dSettings
    settings: Dh3dSettings

    def __init__(self, settings: Dh3dSettings | None = None) -> None:
        settings = s = Dh3dSettings() if settings is None else settings
        super().__init__(settings, PointsRaster)
        for name in ("neighbours", "thinning", "stem", "first", "second", "local", "features"):
            checks.count(f"dh3d.{name}", getattr(s, name), most=8192)
        for name in ("attention", "keypoints"):
            checks.count(f"dh3d.{name}", getattr(s, name), most=8192)
        checks.count("dh3d.agreeing", s.agreeing, 3)
        checks.at_least("dh3d.apart", s.apart, 0, "metres")
        checks.positive("dh3d.reach", s.reach, "metres")
        gates = checks.widths("dh3d.gates", s.gates)
        if len(gates) != 2:
            raise ConfigError(
                f"dh3d.gates: {list(gates)}, expected two numbers, one for each stage"
            )
        coarse = self.raster.shape[0] // s.thinning
        if coarse < max(s.neighbours, 3):
            raise ConfigError(
                f"dh3d.thinning: {s.thinning} leaves {coarse} of {self.raster.shape[0]} points, "
                f"expected at least the dh3d.neighbours={s.neighbours} of a point, and 3"
            )
        self.local = LocalEncoder(s.stem, s.first, s.second, (gates[0], gates[1]), s.local)
        self.detector = Detector(s.local, checks.widths("dh3d.detector", s.detector))
        self.place = PlaceHead(
            s.local, s.features, s.attention, s.clusters, s.dimension, gating=s.gating
        )

    def forward(self, rasters: Float[Tensor, "batch n 3"]) -> Float[Tensor, "batch value"]:
        """Descriptors (b, dimension) float32 of points (b, n, 3), of any floating type."""
        graph = point_graph(self._metres(rasters), self.settings.neighbours, self.settings.thinning)
        return F.normalize(self.place(graph, self.local(graph)), dim=-1)

    def local_points(self, rasters: Float[Tensor, "batch n 3"]) -> LocalPoints:
        """Points in metres, local descriptors and scores of points (b, n, 3)."""
        graph = point_graph(self._metres(rasters), self.settings.neighbours, self.settings.thinning)
        features = self.local(graph)
        scores = torch.sigmoid(self.detector(features))[..., 0]
        return LocalPoints(graph.points, F.normalize(features, dim=-1), scores)

    def relative_poses(
        self, query: Float[Tensor, "n 3"], places: Float[Tensor, "k n 3"]
    ) -> Float64[Tensor, "k 4 4"]:
        """What most matches of the keypoints agree on, in all six degrees of freedom.

        NaN where fewer than ``settings.agreeing`` matches do.
        """
        (one,) = self.keypoints(query[None])
        found = torch.full((len(places), 4, 4), torch.nan, dtype=torch.float64)
        every = (batch for batch in torch.split(places, _AT_ONCE) if len(batch))
        scans = (scan for batch in every for scan in self.keypoints(batch))
        for k, scan in enumerate(scans):
            pairs = mutual_matches(scan.descriptors, one.descriptors)
            points, targets = scan.points[pairs[:, 0]], one.points[pairs[:, 1]]
            agreed = consensus(points, targets, self.settings.reach)
            if agreed is not None and agreed.agreeing >= self.settings.agreeing:
                found[k] = agreed.transform
        return found

    @torch.no_grad()
    def keypoints(self, rasters: Float[Tensor, "batch n 3"]) -> list[Keypoints]:
        """The points of each scan (b, n, 3) that can be relied on most, in evaluation mode."""
        training = [module for module in self.modules() if module.training]
        self.eval()
        try:
            local = self.local_points(rasters.to(next(self.parameters()).device))
        finally:
            for module in training:
                module.training = True
        return [
            Keypoints(points[best], descriptors[best])
            for points, descriptors, scores in zip(*local, strict=True)
            for best in [strongest(points, scores, self.settings.keypoints, self.settings.apart)]
        ]

    def _metres(self, rasters: Float[Tensor, "batch n 3"]) -> Float[Tensor, "batch n 3"]:
        raster = self.raster
        assert isinstance(raster, PointsRaster)
        return rasters.float() * raster.extent

    @property
    def descriptor_shape(self) -> tuple[int]:
        """Length of one descriptor."""
        return (self.settings.dimension,)
