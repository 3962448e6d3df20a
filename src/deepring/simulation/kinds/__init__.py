"""The kinds of worlds, one file each, which furnish the streets."""
