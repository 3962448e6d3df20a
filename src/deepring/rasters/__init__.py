"""A scan becomes the array that a method sees: one kind of raster per file."""
