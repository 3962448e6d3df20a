"""DeepRING: roto-translation invariant LiDAR place recognition."""

__version__ = "0.1.0"
