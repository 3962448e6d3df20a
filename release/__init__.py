"""A release: built, installed and used in empty environments; `python -m release`."""
