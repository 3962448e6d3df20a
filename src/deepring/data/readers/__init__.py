"""One dataset layout per file."""
