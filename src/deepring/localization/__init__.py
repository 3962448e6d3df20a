"""Position of a query: alignment of candidates, maps, loop closures, calibration."""
