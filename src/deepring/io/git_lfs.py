"""Recognises the pointers that Git LFS leaves in place of large files."""

import re
from pathlib import Path

#: What such a file is, after its name; for messages.
LFS_POINTER = "is a Git LFS pointer, not the file itself; fetch it with `git lfs pull`"

#: A pointer has fewer bytes, by its specification.
LONGEST_POINTER = 1024
_TEXT = re.compile(
    rb"version https://(git-lfs|hawser)\.github\.com/spec/\S+\s[^\0]*\boid \w+:\w+\s"
)


def is_lfs_pointer(content: bytes) -> bool:
    """True for the whole content of a pointer, which is a short text."""
    return len(content) < LONGEST_POINTER and _TEXT.match(content) is not None


def is_lfs_pointer_file(path: Path) -> bool:
    """True for a pointer in place of a file; reads at most 1 kB, and nothing of other files."""
    try:
        if not path.is_file() or path.stat().st_size >= LONGEST_POINTER:
            return False
        return is_lfs_pointer(path.read_bytes())
    except (OSError, ValueError):  # e.g. without permission, or an invalid name
        return False
