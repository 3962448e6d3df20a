"""The candidates of a scan: the best places of a map by their descriptors, spread out."""

from typing import NamedTuple

from jaxtyping import Float, Float32, Int64
from torch import Tensor

from deepring.localization.candidates import RerankSettings, spread_out
from deepring.localization.place_store import PlaceStore
from deepring.search.correlation_index import CorrelationIndex

#: Places looked up per candidate, so that enough of them lie apart: more if the first do not.
SURPLUS = (2, 8)


class Candidates(NamedTuple):
    """Candidates, best first."""

    places: Int64[Tensor, " k"]
    poses: Tensor
    """(k, 3): x, y and yaw in the world, metres and radians."""
    turns: Float32[Tensor, " k"]
    """Radians, of the points from place to scan."""
    scores: Float[Tensor, " k"]


def search_candidates(
    index: CorrelationIndex,
    places: PlaceStore,
    descriptor: Float[Tensor, "1 theta omega"],
    settings: RerankSettings,
    before: int | None = None,
) -> Candidates:
    """The candidates of one scan among all places, or among those before number ``before``."""
    number = settings.candidates
    for surplus in SURPLUS:
        hits = index.search(descriptor, surplus * number, before=before)
        poses = places.planar_poses(hits.place[0])
        rows = spread_out(poses[:, :2], settings)
        if len(rows) == number or len(poses) < surplus * number:
            break
    assert hits.turn is not None
    return Candidates(hits.place[0, rows], poses[rows], hits.turn[0, rows], hits.score[0, rows])
