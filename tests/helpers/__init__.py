"""What several test modules need: scenes, drives, bags."""
