"""Fast Histogram (Röhling, Mack and Schulz, IROS 2015): a place by the ranges of its points."""

from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from deepring.checks import of_type
from deepring.methods.method import Comparison, FixedMethod
from deepring.rasters import HistogramRaster


class FastHistogram(FixedMethod):
    """The histogram of ranges, compared by the Wasserstein distance. It knows no turn.

    Descriptors (b, buckets) are cumulative: the share of the points up to the end of each bucket.
    On a line, the Wasserstein distance of two distributions is the L1 distance of these.
    """

    label: ClassVar[str] = "Fast Histogram"

    def __init__(self, raster: HistogramRaster | None = None) -> None:
        self.raster = of_type(
            "Fast Histogram: raster", raster or HistogramRaster(), HistogramRaster
        )

    def describe(self, rasters: Float[Tensor, "batch bucket"]) -> Float[Tensor, "batch bucket"]:
        """Cumulative shares, the last one 1, of shares (b, buckets)."""
        return rasters.float().cumsum(dim=-1)

    def compare(
        self, queries: Float[Tensor, "q bucket"], database: Float[Tensor, "d bucket"]
    ) -> Comparison:
        """-W, at most 0: W = (1/b) Σ_i |Q_i - D_i| of cumulative shares, and no turn.

        W is in units of the whole span: times (farthest - nearest), it is the mean of the metres by
        which the points' ranges have to move.
        """
        distance = torch.cdist(queries.float(), database.float(), p=1.0)
        return Comparison(-distance / queries.shape[-1], None)

    @property
    def descriptor_shape(self) -> tuple[int, ...]:
        """(buckets,) of one descriptor."""
        return self.raster.shape
