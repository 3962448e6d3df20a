"""What several test modules need: scenes, drives, bags, checks of shapes."""

from helpers.shapes import check_shapes

__all__ = ["check_shapes"]
