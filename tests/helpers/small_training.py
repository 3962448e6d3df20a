"""Overrides that make a training short enough for a test."""

#: Of episodes.
EPISODES = ("sampling.ways=2", "sampling.queries=1", "sampling.per_epoch=2")

#: Of the tiny streets, which are 50 m wide: close scans, a narrow validation split; no candidates
#: are aligned.
TINY_DATA = (
    "evaluation.rerank=[]",
    "data.spacing.train=1",
    "data.regions.validation_share=0.3",
    "data.regions.margin=1",
)

#: A training of a few episodes on the tiny streets.
SMALL = (*EPISODES, *TINY_DATA)

#: The tiny streets hold few scans: small batches, and other places from 20 m on.
TINY_METHODS = {
    "deepring": ("method/encoder=unet_small", *EPISODES),
    "pointnetvlad": (
        *("method.raster.count=64", "method.second=[8,8]", "method.clusters=2"),
        *("sampling.negatives=2", "sampling.hard=1", "sampling.hard_from=0"),
        *("sampling.negative_radius=20", "sampling.per_epoch=2"),
    ),
    "lpdnet": (
        *("method.raster.count=64", "method.raster.neighbours=[6,10]", "method.neighbours=4"),
        *("method.second=[8,8]", "method.clusters=2", "method.transform_widths=[8]"),
        *("sampling.negatives=2", "sampling.hard=1", "sampling.hard_from=0"),
        *("sampling.negative_radius=20", "sampling.per_epoch=2"),
    ),
    "disco": (
        *("method.widths=[2,2]", "sampling.positive_radius=10", "sampling.negative_radius=20"),
        *("sampling.negatives=2", "sampling.hard=1", "sampling.hard_from=0"),
        "sampling.per_epoch=2",
    ),
    "egonn": (
        *("method.raster.degrees=6", "method.raster.ring=2", "method.raster.height=2"),
        *("method.raster.max_voxels=200", "method.widths=[2,2]", "method.global_levels=[2]"),
        *("sampling.size=4", "sampling.limit=6", "sampling.per_epoch=2"),
        *("sampling.positive_radius=10", "sampling.negative_radius=20"),
    ),
    "locnet": (
        *("method.raster.rows=16", "method.raster.buckets=20", "method.channels=[2,2]"),
        *("sampling.pairs=4", "sampling.per_epoch=2"),
        *("sampling.positive_radius=10", "sampling.negative_radius=20"),
    ),
    "overlapnet": (
        *("method.raster.sectors=64", "method.raster.rows=12", "method.raster.viewpoint=1.8"),
        *("method.layers=[[5,5,2,2,4],[4,3,1,1,4]]", "method.widths=[2,2,2]", "method.block=6"),
        *("sampling.pairs=4", "sampling.per_epoch=2"),
    ),
    "lcdnet": (
        *("method.raster.keypoints=16", "method.raster.max_points=100", "method.raster.size=2"),
        *("method.raster.preprocessing.height=[-28,20]", "method.raster.full_intensity=255"),
        *("method.widths=[2,2,2,2,4]", "method.features=8", "method.clusters=2"),
        *("method.momentum=0.1", "sampling.pairs=2", "sampling.per_epoch=2"),
        "sampling.positive_radius=10",
    ),
    "dh3d": (
        "stage=dh3d_whole",  # in stages: `test_stages`
        *("method.raster.count=64", "method.stem=4", "method.first=4", "method.second=4"),
        *("method.detector=[4]", "method.features=8", "method.attention=4", "method.clusters=2"),
        *("sampling.negatives=2", "sampling.negative_radius=20", "sampling.per_epoch=2"),
    ),
    "rinet": (
        *("method.raster.sectors=36", "method.widths=[2,2]", "method.steps=[3]"),
        *("sampling.pairs=4", "sampling.per_epoch=2"),
    ),
    "locus": (
        *("method.raster.cells=[4,4,4]", "method.raster.growth=0.02", "method.channels=[2,2,2]"),
        *("method.raster.least_points=20", "method.hidden=8", "method.feature=8"),
        *("loss.cells=[4,4,4]", "loss.feature=8", "sampling.size=4", "sampling.per_epoch=2"),
    ),
}
