"""Rasters, the arrays that methods take in place of scans: one file per kind, one base class."""

from deepring.rasters.base import RASTERS, Raster, make_raster, raster_settings
from deepring.rasters.bev import BevRaster
from deepring.rasters.cart_context import CartContextRaster
from deepring.rasters.channel_ranges import HeightRangesRaster, SemanticRangesRaster
from deepring.rasters.context import ContextRaster
from deepring.rasters.features import FeatureBevRaster
from deepring.rasters.heights import HeightRaster
from deepring.rasters.histogram import HistogramRaster
from deepring.rasters.iris import IrisRaster
from deepring.rasters.m2dp import M2dpRaster
from deepring.rasters.point_features import PointFeaturesRaster
from deepring.rasters.points import PointsRaster
from deepring.rasters.polar import PolarRaster
from deepring.rasters.polar_context import PolarContextRaster
from deepring.rasters.preprocessing import Preprocessing
from deepring.rasters.range_image import RangeRaster
from deepring.rasters.range_normals import RangeNormalRaster
from deepring.rasters.ring_histogram import RingHistogramRaster
from deepring.rasters.segments import SegmentsRaster
from deepring.rasters.semantic import SemanticRaster
from deepring.rasters.semantic_points import SemanticPointsRaster
from deepring.rasters.voxel_means import IntensityMeansRaster, VoxelMeansRaster
from deepring.rasters.voxels import VoxelRaster

__all__ = [
    "RASTERS",
    "BevRaster",
    "CartContextRaster",
    "ContextRaster",
    "FeatureBevRaster",
    "HeightRangesRaster",
    "HeightRaster",
    "HistogramRaster",
    "IntensityMeansRaster",
    "IrisRaster",
    "M2dpRaster",
    "PointFeaturesRaster",
    "PointsRaster",
    "PolarContextRaster",
    "PolarRaster",
    "Preprocessing",
    "RangeNormalRaster",
    "RangeRaster",
    "Raster",
    "RingHistogramRaster",
    "SegmentsRaster",
    "SemanticPointsRaster",
    "SemanticRangesRaster",
    "SemanticRaster",
    "VoxelMeansRaster",
    "VoxelRaster",
    "make_raster",
    "raster_settings",
]
