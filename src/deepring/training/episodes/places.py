"""Places as classes: which scans make the ways of an episode."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deepring.errors import DataError
from deepring.training.training_scans import within

if TYPE_CHECKING:
    from deepring.training.episodes.episode_scheme import EpisodeScheme

#: A neighbour is sought beside this many of the ways drawn last.
RECENT = 3

Way = tuple[int, NDArray[np.int64]]
"""The anchor of a class, and the numbers of its scans."""


class Places:
    """Positions of scans, from which classes are sampled.

    All scans of a class are within ``positive_radius`` of each other, scans of different classes
    beyond ``negative_radius``. With the probability ``neighbours`` a class is anchored within
    ``neighbour_radius`` of the anchor of one of the last three, if one fits there.

    Args:
        points: (n, 3) float64 metres, as `TrainingScans.points`.
        scheme: ways, shots, queries and radii of the episodes.
    """

    def __init__(self, points: NDArray[np.float64], scheme: "EpisodeScheme") -> None:
        self.points, self.scheme = points, scheme
        self.size = scheme.shots + scheme.queries
        self.near = within(points, scheme.positive_radius)
        self.around = within(points, scheme.negative_radius)
        counts = np.array([len(near) for near in self.near], dtype=np.int64)
        self.is_anchor = counts >= self.size
        self.anchors = np.flatnonzero(self.is_anchor)
        self.beside = within(points, scheme.neighbour_radius) if scheme.neighbours else []

    def sample(self, rng: np.random.Generator, tries: int = 20) -> NDArray[np.int64]:
        """Scan indices (ways, shots + queries) of one episode; the shots come first.

        Raises DataError for fewer places than ways.
        """
        most = 0
        for _ in range(tries):
            classes = self._sample_classes(rng)
            if len(classes) == self.scheme.ways:
                return np.stack(classes)
            most = max(most, len(classes))
        s = self.scheme
        raise DataError(
            f"sampling.ways: {s.ways}, but the {len(self.points)} scans of the training region "
            f"contain only {most} places of {self.size} scans within "
            f"{s.positive_radius:g} m of each other and beyond {s.negative_radius:g} m of the "
            "other places; lower sampling.ways or sampling.queries, enlarge the training "
            "region, or lower the spacing of training scans"
        )

    def _sample_classes(self, rng: np.random.Generator) -> list[NDArray[np.int64]]:
        """Up to ``ways`` classes, anchored at scans in random order or beside those before."""
        ways: list[Way] = []
        free = np.ones(len(self.points), dtype=np.bool_)
        order = iter(rng.permutation(self.anchors).tolist())
        while len(ways) < self.scheme.ways:
            way = self._neighbour(ways, free, rng) or self._first(order, free, rng)
            if way is None:
                break
            ways.append(way)
            for member in way[1]:
                free[self.around[member]] = False
        return [members for _, members in ways]

    def _neighbour(
        self, ways: list[Way], free: NDArray[np.bool_], rng: np.random.Generator
    ) -> Way | None:
        """A way beside one of the last; None by chance, and where there is no room for one."""
        share = self.scheme.neighbours
        if not share or not ways or rng.random() >= share:
            return None
        near = np.unique(np.concatenate([self.beside[anchor] for anchor, _ in ways[-RECENT:]]))
        candidates = rng.permutation(near[self.is_anchor[near] & free[near]])
        return self._first(iter(candidates.tolist()), free, rng)

    def _first(
        self, anchors: Iterator[int], free: NDArray[np.bool_], rng: np.random.Generator
    ) -> Way | None:
        """The way of the first anchor that is free and has enough free scans around it."""
        for anchor in anchors:
            if free[anchor]:
                members = self._sample_members(anchor, free, rng)
                if members is not None:
                    return anchor, members
        return None

    def _sample_members(
        self, anchor: int, free: NDArray[np.bool_], rng: np.random.Generator
    ) -> NDArray[np.int64] | None:
        """Random scans around the anchor, each within ``positive_radius`` of all others."""
        near = self.near[anchor][free[self.near[anchor]]]
        candidates = rng.permutation(near[near != anchor])
        members = [anchor]
        for candidate in candidates:
            distances = np.linalg.norm(self.points[members] - self.points[candidate], axis=1)
            if (distances <= self.scheme.positive_radius).all():
                members.append(int(candidate))
            if len(members) == self.size:
                return rng.permutation(np.array(members, dtype=np.int64))
        return None
