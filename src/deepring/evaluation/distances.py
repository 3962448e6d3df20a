"""Distances from queries to the places of a database."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class HasPositions(Protocol):
    """Scans of a session with their positions: a `ScanSet`, or the content of a descriptor file."""

    def __len__(self) -> int: ...

    @property
    def positions(self) -> NDArray[np.float64]:
        """World positions (n, 2), metres."""
        ...

    @property
    def indices(self) -> NDArray[np.int64]:
        """Numbers (n,) of the scans in their session."""
        ...


def nearest_distances(
    query: HasPositions,
    database: HasPositions,
    searched: NDArray[np.int64] | None = None,
    batch: int = 64,
) -> NDArray[np.float32]:
    """Metres (q,) from each query to the nearest place; ``batch`` queries are compared at a time.

    Computed in float64, since world positions may be large numbers. Only the first ``searched``
    (q,) places count for each query; all without it.
    """
    queries, places = query.positions, database.positions
    nearest = np.empty(len(queries), np.float32)
    for start in range(0, len(queries), batch):
        rows = slice(start, start + batch)
        metres = _metres(queries[rows, None] - places)
        if searched is not None:
            metres[np.arange(len(places)) >= searched[rows, None]] = np.inf
        nearest[rows] = metres.min(axis=1)
    return nearest


def distances_to(
    query: HasPositions, database: HasPositions, rows: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Metres (q, k) from each query to the places in its row of ``rows`` (q, k)."""
    return _metres(query.positions[:, None] - database.positions[rows])


def _metres(offset: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.hypot(offset[..., 0], offset[..., 1]).astype(np.float32)
