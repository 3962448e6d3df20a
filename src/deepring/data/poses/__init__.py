"""Pose tables, trajectories, and the matching of scans and poses."""
