"""What is doubtful or wrong about a dataset, found by looking at its values."""
