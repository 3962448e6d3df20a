"""Scan files: listing a folder, decoding records, point clouds and bags."""
