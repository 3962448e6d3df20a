"""Indexes: exhaustive and two-stage search among up to millions of places."""
