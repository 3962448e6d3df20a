"""Datasets: readers of their files, sessions, regions, scan sets and cached rasters."""
