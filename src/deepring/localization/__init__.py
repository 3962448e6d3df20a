"""Where a query is: alignment of candidates, maps, loop closures, calibration."""
