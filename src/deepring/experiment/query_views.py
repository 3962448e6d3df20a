"""Queries of a run with their scans, which are read again from where its config says.

No cache is made, and no class that the config names is imported but the package's own.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.data.dataset import RetrievalSet
from deepring.data.scan_set import ScanSet
from deepring.errors import BrokenScanError, DataError
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.task import rows_of
from deepring.experiment import build
from deepring.experiment.config import Config
from deepring.experiment.method_views import MethodViews
from deepring.experiment.plan import regions_of
from deepring.localization.candidates import RerankSettings, align_candidates
from deepring.methods.method import Method
from deepring.progress import Progress
from deepring.rasters import BevRaster
from deepring.reports.lie import Lie, lie_of
from deepring.reports.query_view import PlaceView, QueryMap, QueryView, ScanView, chosen


def splits_of(cfg: Config) -> Iterator[RetrievalSet]:
    """The retrieval sets that a run was tested on."""
    _, tests = build.datasets(cfg)
    for dataset in tests:
        for region in regions_of(cfg.evaluation, dataset):
            yield dataset.retrieval(region)


def query_map(
    split: RetrievalSet, matches: Sequence[TopMatches], main: TopMatches, radius: float
) -> QueryMap:
    """The queries of a split without pictures.

    Args:
        split: that was tested.
        matches: of all methods in it.
        main: those of the method whose places are shown.
        radius: metres.
    """
    rows = rows_of(split.query, main.query)
    axes = split.query.session.axes
    north_up = -1 if axes[0] == "north" else 1
    across, up = axes[::north_up]
    return QueryMap(
        title=main.case.place,
        method=main.case.method,
        radius=radius,
        axes=(across, up),
        places=split.database.ground_truth[:, ::north_up],
        queries=split.query.ground_truth[rows, ::north_up],
        numbers=main.query,
        found=rows_of(split.database, main.place[:, 0]),
        metres=main.distance[:, 0],
        nearest=main.nearest,
        scores=main.score[:, 0],
        by_method={each.case.method: _metres(each, main.query) for each in matches},
    )


def _metres(matches: TopMatches, queries: NDArray[np.int64]) -> NDArray[np.float32]:
    """Metres to the place that was found for each query; NaN for one that was not asked."""
    known = dict(zip(matches.query.tolist(), matches.distance[:, 0].tolist(), strict=True))
    return np.array([known.get(query, np.nan) for query in queries.tolist()], dtype=np.float32)


def chosen_rows(region: QueryMap, most: int) -> list[int]:
    """The queries that get pictures."""
    return chosen(region.scores, region.answerable & ~region.right, most)


@dataclass(frozen=True, eq=False)
class _Seen:
    """A scan that was read."""

    image: NDArray[np.bool_]
    raster: NDArray[Any] | None
    descriptor: Tensor | None
    view: ScanView


class QueryPictures:
    """Makes the pictures of queries of one split; a place is read once.

    Without a method, with the scans and the overlays alone.
    """

    def __init__(self, split: RetrievalSet, region: QueryMap, method: Method | None) -> None:
        self.split = split
        self.region = region
        self.method = None if method is None else MethodViews(method)
        self.above = BevRaster()
        self._places: dict[int, _Seen] = {}
        self._rows = rows_of(split.query, region.numbers)

    def views(self, rows: Sequence[int], progress: Progress | None = None) -> list[QueryView]:
        """The queries at these rows of the region."""
        views = []
        for number, row in enumerate(rows, 1):
            views.append(self._view(row))
            if progress is not None:
                progress(number, len(rows))
        return views

    def _view(self, row: int) -> QueryView:
        query_row, found_row = int(self._rows[row]), int(self.region.found[row])
        query = self._seen(self.split.query, query_row)
        found = self._place(found_row)
        away = self._away(query_row)
        nearest_row = self._nearest(query_row, away)
        nearest = None
        if nearest_row != found_row:
            place = self._place(nearest_row)
            nearest = self._beside(query, place, query_row, nearest_row, float(away[nearest_row]))
        return QueryView(
            row,
            query.view,
            self._beside(query, found, query_row, found_row, float(away[found_row]), align=True),
            nearest,
        )

    def _away(self, query_row: int) -> NDArray[np.float64]:
        """Metres (p,) from a query to every place."""
        position = self.split.query.positions[query_row]
        away: NDArray[np.float64] = np.linalg.norm(self.split.database.positions - position, axis=1)
        return away

    def _nearest(self, query_row: int, away: NDArray[np.float64]) -> int:
        """The nearest place that can be read, as the evaluation saw them."""
        searched = self.split.searched
        among = away if searched is None else away[: searched[query_row]]
        for row in np.argsort(among, kind="stable").tolist():
            try:
                self._place(row)
            except BrokenScanError:
                continue
            return int(row)
        raise DataError(
            f"scans of {self.split.database.session.name}: none can be read, expected at least one"
        )

    def _place(self, row: int) -> _Seen:
        if row not in self._places:
            self._places[row] = self._seen(self.split.database, row)
        return self._places[row]

    def _seen(self, scans: ScanSet, row: int) -> _Seen:
        image = scans.rasterize(row, self.above)
        number = int(scans.indices[row])
        if self.method is None:
            return _Seen(image, None, None, ScanView(number, image))
        own = self.method.method.raster
        raster = image if own == self.above else scans.rasterize(row, own)
        descriptor = self.method.describe(raster)
        sinogram, drawn = self.method.sinogram(raster), self.method.picture(descriptor)
        return _Seen(image, raster, descriptor, ScanView(number, image, sinogram, drawn))

    def _beside(
        self,
        query: _Seen,
        place: _Seen,
        query_row: int,
        place_row: int,
        metres: float,
        *,
        align: bool = False,
    ) -> PlaceView:
        """A place beside the query; with ``align`` the two images are aligned."""
        frames = self.split.query.frames[query_row], self.split.database.frames[place_row]
        true = lie_of(np.linalg.inv(frames[1]) @ frames[0])
        score = turn = told = curve = None
        if self.method is not None and query.descriptor is not None:
            assert place.descriptor is not None
            assert query.raster is not None
            assert place.raster is not None
            score, turn = self.method.compared(query.descriptor, place.descriptor)
            curve = self.method.curve(query.descriptor, place.descriptor, score)
            told = self.method.lie(query.raster, place.raster, turn) if align else None
        aligned, fit = _aligned(query.image, place.image, turn) if align else (None, 0.0)
        return PlaceView(place.view, metres, score, true, told, aligned, fit, curve)


def _aligned(
    query: NDArray[np.bool_], place: NDArray[np.bool_], turn: float | None
) -> tuple[Lie, float]:
    """How the query's image fits that of the place, and how well."""
    turns = None if turn is None else torch.tensor([turn])
    found = align_candidates(
        torch.from_numpy(query), turns, torch.from_numpy(place)[None], RerankSettings()
    )
    x, y = found.position[0].tolist()
    return Lie(float(found.turn[0]), (x, y)), float(found.score[0])
