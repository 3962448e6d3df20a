"""Retrieval tasks: queries and database, with the rasters of both."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.data.cache import RasterCache, load_rasters
from deepring.data.dataset import RetrievalSet
from deepring.data.packed_rasters import Rasters
from deepring.data.scan_set import ScanSet
from deepring.errors import DataError
from deepring.evaluation.case import Case
from deepring.rasters import Raster


@dataclass(frozen=True, eq=False)
class RetrievalTask:
    """Queries and the database in which they are looked up, as rasters of one kind."""

    scans: RetrievalSet
    """Name and region, and the scans of both sides."""
    database: Rasters
    query: Rasters

    def case(self, method: str, train: str = "") -> Case:
        """The case of a method on this task; ``train`` names its training datasets."""
        return Case(method, train, self.scans.name, self.scans.region)


def load_task(cache: RasterCache, scans: RetrievalSet, raster: Raster) -> RetrievalTask:
    """The rasters of both sides; scans that cannot be read are left out, with a warning.

    Raises DeepringError if no scan of a side can be read.
    """
    where = f"{scans.name} {scans.region}"
    database, database_rasters = load_rasters(cache, scans.database, raster, f"{where}: database")
    wanted = scans.among(database, scans.query).query
    query, query_rasters = load_rasters(cache, wanted, raster, f"{where}: queries")
    return RetrievalTask(scans.among(database, query), database_rasters, query_rasters)


def rows_of(scans: ScanSet, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows in the set, of the shape of ``numbers``, of the scans with these session numbers.

    Raises DataError for a number of no scan in the set.
    """
    order = np.argsort(scans.indices)
    place = np.searchsorted(scans.indices, numbers, sorter=order)
    rows = order[np.minimum(place, len(order) - 1)]
    absent = numbers[scans.indices[rows] != numbers]
    if absent.size:
        raise DataError(
            f"scans {sorted(set(absent.tolist()))[:3]} of session {scans.session.name}: not among "
            "the scans that can be read; expected all scans of the retrievals; evaluate again"
        )
    return rows
