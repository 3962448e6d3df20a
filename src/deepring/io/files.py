"""Files that appear whole or not at all."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from deepring.errors import FileError


def part_of(path: Path) -> Path:
    """The hidden file that holds ``path``'s content until it is whole."""
    return path.with_name(f".{path.name}.part")


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """A temporary path beside ``path`` to write to; put in its place in one step at the end.

    Folders are made as needed. Where the block raises, ``path`` stays as it was; a process that
    is killed leaves at most a hidden ``.<name>.part``, which the next one replaces. Raises
    FileError where the file cannot be written.
    """
    path = Path(path)
    temporary = part_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise FileError(
            f"{path}: cannot be written ({error.strerror}); expected a path to write to"
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_whole(path: Path, chunks: Iterable[bytes]) -> None:
    """Write ``chunks`` to ``path`` as `replacing` does."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.writelines(chunks)
