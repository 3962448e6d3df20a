"""Files that appear whole or not at all."""

from collections.abc import Iterable
from pathlib import Path


def part_of(path: Path) -> Path:
    """The hidden file that holds ``path``'s content until it is whole."""
    return path.with_name(f".{path.name}.part")


def write_whole(path: Path, chunks: Iterable[bytes]) -> None:
    """Write ``chunks`` beside ``path``, then put the file in place in one step.

    An interrupted run leaves at most a hidden ``.<name>.part``, which the next one replaces.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = part_of(path)
    with part.open("wb") as file:
        file.writelines(chunks)
    part.replace(path)
