"""Maps out of point clouds: virtual scans of places along a path or where the ground was seen."""
