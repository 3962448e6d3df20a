"""Every registered method at a size that describes a scan in milliseconds, untrained."""

from dataclasses import replace

import torch

from deepring.methods.deepring import DeepRing
from deepring.methods.dh3d import Dh3d, Dh3dSettings
from deepring.methods.disco import Disco, DiscoSettings
from deepring.methods.egonn import EgoNnGlobal, EgoNnSettings
from deepring.methods.fast_histogram import FastHistogram
from deepring.methods.lcdnet import LcdNet, LcdNetSettings
from deepring.methods.lidar_iris import LidarIris
from deepring.methods.locnet import LocNet, LocNetSettings
from deepring.methods.locus import Locus, LocusSettings
from deepring.methods.lpdnet import LpdNet, LpdNetSettings
from deepring.methods.m2dp import M2dp
from deepring.methods.overlapnet import OverlapNet, OverlapNetSettings
from deepring.methods.pointnetvlad import PointNetVlad, PointNetVladSettings
from deepring.methods.rinet import RINet, RINetSettings
from deepring.methods.ring import Ring
from deepring.methods.ring_plus_plus import RingPlusPlus
from deepring.methods.scan_context import ScanContext
from deepring.methods.scan_context_plus_plus import CartContext, PolarContext
from deepring.methods.ssc import Ssc
from deepring.rasters import (
    BevRaster,
    ContextRaster,
    FeatureBevRaster,
    HeightRaster,
    HistogramRaster,
    IrisRaster,
    PointFeaturesRaster,
    PointsRaster,
    PolarContextRaster,
    Preprocessing,
    RangeNormalRaster,
    RingHistogramRaster,
    SegmentsRaster,
    SemanticPointsRaster,
    SemanticRangesRaster,
    VoxelMeansRaster,
    VoxelRaster,
    raster_settings,
)
from deepring.testing import walls
from helpers.networks import deepring_settings

BEV = BevRaster(cells=24)
CONTEXT = ContextRaster(sectors=24, rings=8)
HEIGHTS = HeightRaster(layers=2, sectors=24, rings=16)
IRIS = IrisRaster(sectors=72, rings=20)
POLAR_CONTEXT = PolarContextRaster(sectors=24, rings=8, least=1)
POINTS = PointsRaster(count=64)
POINT_FEATURES = PointFeaturesRaster(count=64, neighbours=(6, 10))
CLASSES = SemanticPointsRaster(sectors=36, rings=10, count=300)
RANGES = RangeNormalRaster(
    sectors=64, rows=12, elevation=(-25, 30), viewpoint=1.8, normals="radial"
)
RINGS = RingHistogramRaster(rows=16, buckets=20)
MEANS = VoxelMeansRaster(200, 24, 2.0, 48.0, Preprocessing(height=(-28.0, 20.0), clearance=None))
SEGMENTS = SegmentsRaster(
    max_segments=12, cells=(4, 4, 4), tolerance=2.0, least_points=10, most_points=3000
)
VOXELS = VoxelRaster(degrees=6.0, ring=2.0, height=2.0, max_voxels=200)


def deepring(seed=0, **changes):
    torch.manual_seed(seed)
    values = {"raster": raster_settings(BEV), "angles": 24, "bins": 24, "widths": (4, 6)}
    network = DeepRing(deepring_settings(**{**values, **changes}))
    # With the norms' first statistics, descriptors of all scans are equal up to rounding.
    images = torch.stack([torch.from_numpy(BEV(walls(k), 0.0)) for k in range(8)])
    for _ in range(20):
        network(images)
    return network.eval()


def disco(**changes):
    torch.manual_seed(0)
    values = {"raster": raster_settings(HEIGHTS), "widths": (4, 6), "size": 8}
    return Disco(DiscoSettings(**{**values, **changes}))


def pointnetvlad():
    torch.manual_seed(0)
    settings = PointNetVladSettings(
        raster_settings(POINTS), (8,), (8, 16), (8,), (8,), clusters=2, dimension=16
    )
    return PointNetVlad(settings)


def lpdnet():
    torch.manual_seed(0)
    settings = LpdNetSettings(
        raster_settings(POINT_FEATURES), first=(8,), graph=(8,), spatial=(8,), second=(8, 16),
        neighbours=4, transform_widths=(8,), transform_hidden=(8,), clusters=2, dimension=16,
    )  # fmt: skip
    return LpdNet(settings)


def egonn():
    torch.manual_seed(0)
    return EgoNnGlobal(EgoNnSettings(raster_settings(VOXELS), widths=(4, 4), global_levels=(2,)))


def locnet():
    torch.manual_seed(0)
    return LocNet(LocNetSettings(raster_settings(RINGS), channels=(4, 6), dimension=8))


def lcdnet():
    torch.manual_seed(0)
    values = {"features": 16, "clusters": 4, "dimension": 8, "momentum": 0.1}
    return LcdNet(LcdNetSettings(raster_settings(MEANS), widths=(4, 4, 6, 6, 8), **values))


def rinet():
    torch.manual_seed(0)
    raster = raster_settings(SemanticRangesRaster(sectors=36))
    return RINet(RINetSettings(raster, widths=(4, 8), steps=(3,), hidden=8))


def locus():
    torch.manual_seed(0)
    values = {"channels": (2, 2, 2), "hidden": 8, "feature": 8, "least_segments": 2}
    return Locus(LocusSettings(raster_settings(SEGMENTS), **values)).eval()


TINY_OVERLAPNET = OverlapNetSettings(
    raster_settings(RANGES),
    layers=((5, 5, 2, 2, 4), (4, 3, 1, 1, 6)),
    circular=True,
    block=8,
    widths=(8, 8, 8),
)


def overlapnet(**changes):
    torch.manual_seed(0)
    return OverlapNet(replace(TINY_OVERLAPNET, **changes)).eval()


def dh3d():
    torch.manual_seed(0)
    widths = {"stem": 4, "first": 4, "second": 8, "gates": (2, 2), "local": 8, "detector": (4,)}
    head = {"features": 8, "attention": 4, "clusters": 2, "dimension": 16, "keypoints": 32}
    return Dh3d(Dh3dSettings(raster_settings(POINTS), **widths, **head))


TINY = {
    "deepring": deepring,
    "ring": lambda: Ring(BEV, angles=24, bins=24),
    "ring_plus_plus": lambda: RingPlusPlus(FeatureBevRaster(cells=24), angles=24, bins=24),
    "scan_context": lambda: ScanContext(CONTEXT),
    "fast_histogram": lambda: FastHistogram(HistogramRaster(buckets=20)),
    "m2dp": M2dp,
    "lidar_iris": lambda: LidarIris(IRIS),
    "polar_context": lambda: PolarContext(POLAR_CONTEXT),
    "cart_context": CartContext,
    "ssc": lambda: Ssc(CLASSES),
    "disco": disco,
    "pointnetvlad": pointnetvlad,
    "lpdnet": lpdnet,
    "egonn": egonn,
    "locnet": locnet,
    "overlapnet": overlapnet,
    "rinet": rinet,
    "lcdnet": lcdnet,
    "dh3d": dh3d,
    "locus": locus,
}
