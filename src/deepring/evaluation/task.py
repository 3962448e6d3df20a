"""A retrieval task: queries and database, and the rasters of both that a method describes."""

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
    """Queries to be looked up in a database, as one kind of raster shows them."""

    scans: RetrievalSet
    """Name and region, and the scans of both sides."""
    database: Rasters
    query: Rasters

    def case(self, method: str, train: str = "") -> Case:
        """A method on this task; ``train`` names what it was trained on."""
        return Case(method, train, self.scans.name, self.scans.region)


def load_task(cache: RasterCache, scans: RetrievalSet, raster: Raster) -> RetrievalTask:
    """The rasters of both sides; scans that cannot be read are left out, with a warning.

    Raises DeepringError where none of a side can be read.
    """
    where = f"{scans.name} {scans.region}"
    database, shown = load_rasters(cache, scans.database, raster, f"{where}: database")
    query, asked = load_rasters(cache, scans.query, raster, f"{where}: queries")
    return RetrievalTask(RetrievalSet(scans.name, scans.region, database, query), shown, asked)


def rows_of(scans: ScanSet, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where in the set the scans lie that have these numbers in their session; of any shape.

    Raises DataError for a number that no scan of the set has.
    """
    order = np.argsort(scans.indices)
    place = np.searchsorted(scans.indices, numbers, sorter=order)
    rows = order[np.minimum(place, len(order) - 1)]
    absent = numbers[scans.indices[rows] != numbers]
    if absent.size:
        raise DataError(
            f"scans {sorted(set(absent.tolist()))[:3]} of session {scans.session.name}: not among "
            "those that are at hand; expected all that were retrieved; evaluate again"
        )
    return rows
