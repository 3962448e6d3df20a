"""RING++: RING of local features instead of occupancy (Xu et al. 2023; lus6-Jenny/RING)."""

from typing import ClassVar

from deepring.methods.ring import Ring
from deepring.rasters import FeatureBevRaster, Raster


class RingPlusPlus(Ring):
    """RING with six channels: descriptors (b, angles, 6 (bins // 2 + 1)).

    Channels are normalised each by itself, as `circorr2` of the published code does, and share
    the shift: their correlations are summed. With ``correlation='published'`` magnitudes are
    summed over frequencies and channels alike. As with RING, the turn is known modulo π only.
    """

    label: ClassVar[str] = "RING++"
    raster_class: ClassVar[type[Raster]] = FeatureBevRaster
