"""From the scans of a drive to its trajectory: odometry, loops, pose graph, errors, files."""
