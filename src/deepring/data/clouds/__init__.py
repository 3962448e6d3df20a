"""Point clouds of whole areas: files of any size, tiles, and whether they can be what they say."""
