"""Scan files: lists folders, and decodes records, point clouds and bags."""
