"""The functions one reads from top to bottom: train and evaluate, and their configuration."""
