"""Atomic file writing, and sealed files of tensors and typed values."""
