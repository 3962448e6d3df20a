"""Scan Context++ (Kim, Choi and Kim, T-RO 2022): polar and Cartesian contexts, aligned by a key."""

from typing import ClassVar

import torch
from jaxtyping import Float, Int64, Shaped
from torch import Tensor

from deepring.checks import count, of_type, positive
from deepring.core.correlation import correlation_curves, shift_to_turn
from deepring.methods.method import Comparison, FixedMethod
from deepring.methods.scan_context import unit_columns
from deepring.rasters import CartContextRaster, PolarContextRaster, Raster
from deepring.search.compare_index import CompareIndex
from deepring.search.hits import Index
from deepring.search.search_settings import SearchSettings
from deepring.search.shortlist import ShortlistIndex, key_distances, shortlisted


class PolarContext(FixedMethod):
    """Largest heights over polar cells; the cosine of columns, near the shift that a key proposes.

    Descriptors are (b, copies, columns, rows): a column is what the original calls one, a sector
    here. A query is compared by the first of its copies with every copy of an entry, and the best
    counts. The ``candidates`` entries with the nearest retrieval keys are compared; None compares
    all. Shifts are tried within half of ``window``, a share of the columns, to either side of the
    one at which the aligning keys are nearest.
    """

    label: ClassVar[str] = "Scan Context++"
    raster_class: ClassVar[type[Raster]] = PolarContextRaster

    def __init__(
        self, raster: Raster | None = None, candidates: int | None = 10, window: float = 0.1
    ) -> None:
        self.raster = self.raster_class() if raster is None else raster
        of_type(f"{self.label}: raster", self.raster, self.raster_class)
        if candidates is not None:
            count(f"{self.label}: candidates", candidates)
        self.candidates = candidates
        self.window = positive(f"{self.label}: window", window)

    def describe(
        self, rasters: Shaped[Tensor, "batch copy column row"]
    ) -> Float[Tensor, "batch copy column row"]:
        """The heights as float32."""
        return rasters.float()

    def compare(
        self,
        queries: Float[Tensor, "q copy column row"],
        database: Float[Tensor, "d copy column row"],
    ) -> Comparison:
        """The mean cosine over columns that are non-empty in both; -1 for no candidates."""
        pairs = len(queries), len(database), database.shape[1]
        one, every = queries[:, 0], database.flatten(0, 1)
        scores, shifts = aligned_cosines(one, every, self.window)
        score, copy = scores.view(pairs).max(dim=-1)
        shift = shifts.view(pairs).gather(-1, copy[..., None])[..., 0]
        distance = key_distances(retrieval_keys(queries), retrieval_keys(database))
        score = torch.where(shortlisted(distance, self.candidates), score, -1.0)
        return Comparison(score, self._turn(shift, queries.shape[-2]))

    @property
    def descriptor_shape(self) -> tuple[int, ...]:
        """(copies, columns, rows) of one descriptor."""
        return self.raster.shape

    def index(self, settings: SearchSettings | None = None) -> Index:  # noqa: ARG002
        """Search by `compare`; takes no settings."""
        if self.candidates is None:
            return CompareIndex(self)
        return ShortlistIndex(self, retrieval_keys, self.candidates)

    def _turn(self, shift: Int64[Tensor, "q d"], columns: int) -> Float[Tensor, "q d"] | None:
        return shift_to_turn(shift, columns)


class CartContext(PolarContext):
    """Largest heights over cells across and along the way. It knows no turn.

    Columns lie across the way, so that the shift is a lateral one. A context of a scan that is
    turned is another one: places are found again along the same way alone, and with
    ``raster.reverse`` along it the other way round.
    """

    label: ClassVar[str] = "Cart Context"
    raster_class: ClassVar[type[Raster]] = CartContextRaster

    def _turn(self, shift: Int64[Tensor, "q d"], columns: int) -> None:  # noqa: ARG002
        return None


def aligned_cosines(
    queries: Float[Tensor, "q column row"], places: Float[Tensor, "n column row"], window: float
) -> tuple[Float[Tensor, "q n"], Int64[Tensor, "q n"]]:
    """The mean cosine over the columns filled in both, and its shift, near the proposed shift.

    The shift at which the aligning keys are nearest by L2 is the one at which their circular
    correlation is largest: shifts leave their norms as they are.
    """
    columns = queries.shape[-2]
    proposed = correlation_curves(aligning_keys(queries), aligning_keys(places)).argmax(dim=-1)
    apart = (torch.arange(columns, device=queries.device) - proposed[..., None]).abs()
    near = torch.minimum(apart, columns - apart) <= round(0.5 * window * columns)
    (q_units, q_filled), (units, filled) = unit_columns(queries), unit_columns(places)
    shared = correlation_curves(q_filled, filled).round()
    cosines = correlation_curves(q_units, units) / shared.clamp_min(1.0)
    best = torch.where(near, torch.where(shared > 0, cosines, 0.0), -torch.inf).max(dim=-1)
    return best.values, best.indices


def retrieval_keys(
    contexts: Float[Tensor, "n copy column row"],
) -> Float[Tensor, "n copy row"]:
    """Mean over the columns, which no shift of them changes."""
    return contexts.float().mean(dim=-2)


def aligning_keys(contexts: Float[Tensor, "n column row"]) -> Float[Tensor, "n column 1"]:
    """Mean over the rows, which shifts as the columns do."""
    return contexts.float().mean(dim=-1, keepdim=True)
