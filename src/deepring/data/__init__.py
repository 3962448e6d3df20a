"""From files on disk to episodes: readers, regions, places, cache, datamodule."""
