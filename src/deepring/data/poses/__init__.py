"""Pose tables, trajectories, and the pose of each scan."""
