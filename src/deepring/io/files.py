"""Writes files atomically: completely or not at all."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from deepring.errors import FileError


def part_of(path: Path) -> Path:
    """The hidden file that holds the content of ``path`` until it is complete."""
    return path.with_name(f".{path.name}.part")


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """A temporary path beside ``path`` to write to, which replaces ``path`` at the end.

    Creates folders as needed. If the block raises, ``path`` does not change; a killed process
    leaves at most a hidden ``.<name>.part``, which the next one replaces. Raises FileError if the
    file cannot be written.
    """
    path = Path(path)
    temporary = part_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise FileError(
            f"{path}: cannot be written ({error.strerror}); expected a writable path"
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_whole(path: Path, chunks: Iterable[bytes]) -> None:
    """Write ``chunks`` to ``path`` as `replacing` does."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.writelines(chunks)
