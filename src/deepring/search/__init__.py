"""Looking places up: exhaustive and two-stage search over maps of up to millions of places."""
