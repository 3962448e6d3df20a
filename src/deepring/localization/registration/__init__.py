"""Registration of the points of two scans, in three dimensions, and how well it holds."""
