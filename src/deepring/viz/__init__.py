"""Figures for files and for TensorBoard."""
