"""M2DP (He, Wang and Zhang, IROS 2016): the scan projected onto many planes."""

from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from deepring.checks import of_type
from deepring.methods.method import Comparison, FixedMethod
from deepring.rasters import M2dpRaster
from deepring.search.compare_index import CompareIndex
from deepring.search.hits import Index
from deepring.search.search_settings import SearchSettings
from deepring.search.vector_index import VectorIndex


class M2dp(FixedMethod):
    """The first singular vectors of a scan's projections, compared by L2. It knows no turn.

    Descriptors are (b, signs, values), see `M2dpRaster`. A scan is put into its own axes first,
    whose signs hang on the sensor's heading: as published, a place seen the other way round is
    another place. With a raster of 4 signs, the query is compared with an entry of every sign of
    its two horizontal axes, and the nearest counts; that is ours.
    """

    label: ClassVar[str] = "M2DP"

    def __init__(self, raster: M2dpRaster | None = None) -> None:
        self.raster = of_type("M2DP: raster", raster or M2dpRaster(), M2dpRaster)

    def describe(
        self, rasters: Float[Tensor, "batch sign value"]
    ) -> Float[Tensor, "batch sign value"]:
        """The rasters, which are the descriptors."""
        return rasters.float()

    def compare(
        self, queries: Float[Tensor, "q sign value"], database: Float[Tensor, "d sign value"]
    ) -> Comparison:
        """-‖Q - D‖, of Q as it is and of D with the signs that suit best, and no turn."""
        signs = database.shape[1]
        # Without matrix products, whose cancellation confuses descriptors that are close.
        apart = torch.cdist(
            queries[:, 0].float(),
            database.flatten(0, 1).float(),
            compute_mode="donot_use_mm_for_euclid_dist",
        )
        return Comparison(-apart.view(len(queries), len(database), signs).amin(dim=-1), None)

    @property
    def descriptor_shape(self) -> tuple[int, ...]:
        """(signs, values) of one descriptor."""
        return self.raster.shape

    def index(self, settings: SearchSettings | None = None) -> Index:  # noqa: ARG002
        """Exhaustive search by L2; takes no settings."""
        return VectorIndex("l2") if self.raster.shape[0] == 1 else CompareIndex(self)
