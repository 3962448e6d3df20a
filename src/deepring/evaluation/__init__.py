"""Queries in, figures out: tasks, look-up, matches, metrics, results, exported descriptors."""
