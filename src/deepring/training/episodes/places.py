"""Places as classes: which scans make the ways of an episode."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.errors import DataError
from deepring.training.training_scans import within

if TYPE_CHECKING:
    from deepring.training.episodes.episode_scheme import EpisodeScheme

#: A neighbour is sought beside this many of the ways drawn last.
RECENT = 3

Mask = NDArray[np.bool_]

Way = tuple[int, NDArray[np.int64]]
"""The anchor of a class, and the numbers of its scans."""


class Free(NamedTuple):
    """Masks (n,) of the scans that an episode may still take."""

    scans: Mask
    """As any scan of a way."""
    shots: Mask
    """As a shot."""


class Places:
    """Positions of scans, from which classes are sampled.

    All scans of a class are within ``positive_radius`` of each other, scans of different classes
    beyond ``negative_radius``. With the probability ``neighbours`` a class is anchored within
    ``neighbour_radius`` of the anchor of one of the last three, if one fits there. If the classes
    are ``overlapping``, shots of different classes alone are beyond ``negative_radius``.

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
            f"{s.positive_radius:g} m of each other and {'with shots ' * s.overlapping}beyond "
            f"{s.negative_radius:g} m of the other places; lower sampling.ways or "
            "sampling.queries, enlarge the training region, or lower the spacing of training scans"
        )

    def _sample_classes(self, rng: np.random.Generator) -> list[NDArray[np.int64]]:
        """Up to ``ways`` classes, anchored at scans in random order or beside those before."""
        ways: list[Way] = []
        free = Free(*np.ones((2, len(self.points)), dtype=np.bool_))
        order = iter(rng.permutation(self.anchors).tolist())
        while len(ways) < self.scheme.ways:
            way = self._neighbour(ways, free, rng) or self._first(order, free, rng)
            if way is None:
                break
            ways.append(way)
            self._take(way[1], free)
        return [members for _, members in ways]

    def _take(self, members: NDArray[np.int64], free: Free) -> None:
        """Mark what no other class may take beside a class of these scans."""
        free.scans[members] = False
        if self.scheme.overlapping:
            members = members[: self.scheme.shots]
        for member in members:
            free.shots[self.around[member]] = False
            if not self.scheme.overlapping:
                free.scans[self.around[member]] = False

    def _neighbour(self, ways: list[Way], free: Free, rng: np.random.Generator) -> Way | None:
        """A way beside one of the last; None by chance, and where there is no room for one."""
        share = self.scheme.neighbours
        if not share or not ways or rng.random() >= share:
            return None
        near = np.unique(np.concatenate([self.beside[anchor] for anchor, _ in ways[-RECENT:]]))
        candidates = rng.permutation(near[self.is_anchor[near]])
        return self._first(iter(candidates.tolist()), free, rng)

    def _first(self, anchors: Iterator[int], free: Free, rng: np.random.Generator) -> Way | None:
        """The way of the first anchor that is free and has enough free scans around it."""
        for anchor in anchors:
            if free.scans[anchor] and free.shots[anchor]:
                members = self._sample_members(anchor, free, rng)
                if members is not None:
                    return anchor, members
        return None

    def _sample_members(
        self, anchor: int, free: Free, rng: np.random.Generator
    ) -> NDArray[np.int64] | None:
        """Random scans around the anchor, each within ``positive_radius`` of all others."""
        near = self.near[anchor][free.scans[self.near[anchor]]]
        candidates = rng.permutation(near[near != anchor])
        if not self.scheme.overlapping:
            members = self._grown([anchor], candidates, self.size)
            return None if members is None else rng.permutation(np.array(members, dtype=np.int64))
        shots = self._grown([anchor], candidates[free.shots[candidates]], self.scheme.shots)
        if shots is None:
            return None
        members = self._grown(shots, candidates[~np.isin(candidates, shots)], self.size)
        return None if members is None else np.array(members, dtype=np.int64)

    def _grown(
        self, members: list[int], candidates: NDArray[np.int64], size: int
    ) -> list[int] | None:
        """The members and the first candidates that are near all of them; None if too few."""
        members = list(members)
        for candidate in candidates:
            if len(members) == size:
                break
            distances = np.linalg.norm(self.points[members] - self.points[candidate], axis=1)
            if (distances <= self.scheme.positive_radius).all():
                members.append(int(candidate))
        return members if len(members) == size else None
