"""Trained networks for where there is no PyTorch."""
