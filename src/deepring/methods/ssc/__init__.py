"""SSC, Semantic Scan Context (Li et al., IROS 2021): classes over polar cells, after alignment."""

import math
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float, Float64, Int64, Shaped
from torch import Tensor

from deepring.checks import count, of_type
from deepring.core.correlation import shift_to_turn
from deepring.core.rigid import planar_pose
from deepring.errors import DataError
from deepring.methods.method import Comparison, FixedMethod
from deepring.methods.ssc.ssc_index import SscIndex
from deepring.methods.ssc.ssc_keys import key_distances, label_keys
from deepring.methods.ssc.ssc_pairs import Alignments, PairSettings, align_query
from deepring.rasters import SemanticPointsRaster
from deepring.rasters.classes import CLASSES
from deepring.rasters.semantic_points import FULL
from deepring.search.search_settings import SearchSettings


class Alignment(NamedTuple):
    """How the points of an entry come to lie on those of a query."""

    score: float
    """Share of alike cells, in [0, 1]."""
    turn: float
    """Turn of the points from entry to query, radians in [-π, π), counter-clockwise."""
    offset: tuple[float, float]
    """x and y in metres, by which the turned points of the entry are moved onto the query's."""


class Ssc(FixedMethod):
    """Turn and offset from landmarks, then the share of polar cells that are of one class in both.

    The turn is the roll of the landmarks' ranges with the least L1 distance; the offset comes from
    pairs of landmarks, each with the nearest within ``window`` sectors, step by step (the paper's
    fast semantic ICP); then the entry's points are turned, moved, and drawn again. The score is the
    number of cells of the same class over the number of cells filled in either.

    Descriptors are (b, sectors + count, 3): x, y in metres and the class, as in
    `SemanticPointsRaster`. With ``match_labels`` landmarks are paired within their class, as in the
    paper; the published code does not look at it. With ``candidates`` only so many entries are
    aligned, those whose classes at each distance are most alike; None aligns all, as in the paper.
    """

    raster: SemanticPointsRaster

    def __init__(
        self,
        raster: SemanticPointsRaster | None = None,
        candidates: int | None = None,
        match_labels: bool = True,
        window: int = 20,
    ) -> None:
        raster = SemanticPointsRaster() if raster is None else raster
        self.raster = of_type("SSC: raster", raster, SemanticPointsRaster)
        if candidates is not None:
            count("SSC: candidates", candidates)
        self.candidates = candidates
        self.match_labels = of_type("SSC: match_labels", match_labels, bool)
        self.window = count("SSC: window", window, most=self.raster.sectors)

    def describe(
        self, rasters: Shaped[Tensor, "batch point 3"]
    ) -> Float[Tensor, "batch point xyc"]:
        """The points in metres, with their classes, as float32."""
        values = rasters.to(torch.float32, copy=True)
        values[..., :2] *= self.raster.radius / FULL
        return values

    def compare(
        self, queries: Float[Tensor, "q point xyc"], database: Float[Tensor, "d point xyc"]
    ) -> Comparison:
        """The share of alike cells; of entries that are no candidates -1, and no turn (NaN)."""
        places = expect_points("queries", queries, self), expect_points("database", database, self)
        score = torch.full((len(queries), len(database)), -1.0)
        turn = torch.full_like(score, math.nan)
        if not score.numel():
            return Comparison(score.to(queries.device), turn.to(queries.device))
        which = self._candidates(*places)
        for k, query in enumerate(places[0]):
            found = align_query(query, places[1], which[k], self.pair_settings)
            score[k, which[k]] = found.score
            turn[k, which[k]] = shift_to_turn(found.roll, self.raster.sectors)
        return Comparison(score.to(queries.device), turn.to(queries.device))

    def align(self, query: Any, entry: Any) -> Alignment:
        """How one entry (points, 3) comes to lie on one query (points, 3).

        Raises DataError for other descriptors than `describe` gives.
        """
        one = torch.as_tensor(query)[None], torch.as_tensor(entry)[None]
        places = expect_points("query", one[0], self), expect_points("entry", one[1], self)
        found: Alignments = align_query(
            places[0][0], places[1], torch.zeros(1, dtype=torch.int64), self.pair_settings
        )
        turn = shift_to_turn(found.roll, self.raster.sectors)
        x, y = found.offset[0].tolist()
        return Alignment(float(found.score[0]), float(turn[0]), (x, y))

    def relative_poses(
        self, query: Shaped[Tensor, "point 3"], places: Shaped[Tensor, "k point 3"]
    ) -> Float64[Tensor, "k 4 4"]:
        """Turn and offset of `align`, see `RelativePoses`; z, roll and pitch stay as they are.

        NaN where a scan has no landmarks, which then say nothing of its pose. An offset beyond the
        limit of 5 m along an axis is 0, as published.
        """
        (one,), every = self.describe(query[None]).cpu(), self.describe(places).cpu()
        found = align_query(one, every, torch.arange(len(every)), self.pair_settings)
        turns = shift_to_turn(found.roll, self.raster.sectors).tolist()
        poses = torch.full((len(every), 4, 4), math.nan, dtype=torch.float64)
        told = self._has_landmarks(every) & self._has_landmarks(one[None])
        for k in told.nonzero()[:, 0].tolist():
            x, y = found.offset[k].tolist()
            poses[k] = torch.from_numpy(planar_pose(x, y, turns[k]))
        return poses

    def _has_landmarks(self, points: Float[Tensor, "n point xyc"]) -> Bool[Tensor, " n"]:
        return (points[:, : self.raster.sectors, 2] > 0).any(dim=1)

    @property
    def descriptor_shape(self) -> tuple[int, int]:
        """Points, and 3 for x, y and class."""
        return self.raster.shape

    @property
    def pair_settings(self) -> PairSettings:
        """What aligning a pair depends on."""
        raster = self.raster
        return PairSettings(
            raster.sectors, raster.rings, raster.radius, self.match_labels, self.window
        )

    def index(self, settings: SearchSettings | None = None) -> SscIndex:  # noqa: ARG002
        """Search by `compare`; takes no settings."""
        return SscIndex(self.pair_settings, self.candidates)

    def _candidates(
        self, queries: Float[Tensor, "q point xyc"], database: Float[Tensor, "d point xyc"]
    ) -> Int64[Tensor, "q _"]:
        """The entries to align with each query."""
        if self.candidates is None or self.candidates >= len(database):
            return torch.arange(len(database)).expand(len(queries), -1)
        keys = [label_keys(part, self.pair_settings) for part in (queries, database)]
        return key_distances(*keys).topk(self.candidates, largest=False).indices


def expect_points(name: str, values: Tensor, method: Ssc) -> Float[Tensor, "n point xyc"]:
    """The descriptors, on the CPU. Raises DataError for other ones than the method's."""
    if tuple(values.shape[1:]) != method.descriptor_shape:
        raise DataError(
            f"{name}: shape {tuple(values.shape)}, expected (n, {method.raster.shape[0]}, 3): "
            "points as `describe` gives them"
        )
    classes = values[..., 2]
    if len(values) and not bool(((classes >= 0) & (classes < len(CLASSES))).all()):
        raise DataError(
            f"{name}: a class {float(classes.abs().max()):g}, expected 0 to {len(CLASSES) - 1}"
        )
    return values.cpu().float()
