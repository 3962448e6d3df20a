"""Metrics, retrieval and the evaluation protocol."""
