"""Datasets: readers, sessions, regions, scan sets and cached rasters."""
