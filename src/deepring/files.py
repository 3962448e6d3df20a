"""Files that appear whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from deepring.errors import DeepringError


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """A temporary path beside ``path`` to write to; put in its place in one step at the end.

    Folders are made as needed. Where the block raises, ``path`` stays as it was. Raises
    DeepringError where the file cannot be written.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise DeepringError(f"{path}: {error}; expected a path to write to") from error
    finally:
        with suppress(OSError):
            temporary.unlink()
