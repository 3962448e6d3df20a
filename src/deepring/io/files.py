"""Writes files atomically: completely or not at all."""

import errno
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from deepring.errors import FileError

#: The reasons of the operating system that a user can do something about.
_REASONS = {
    errno.ENOENT: "no such file or folder",
    errno.EACCES: "no permission to read or write it",
    errno.EPERM: "no permission to read or write it",
    errno.EROFS: "it lies on a read-only disk",
    errno.EISDIR: "it is a folder, expected a file",
    errno.ENOTDIR: "it lies below a file, expected folders above it",
    errno.EEXIST: "it exists, expected a new file",
    errno.ENOSPC: "no space is left on the disk",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "it is larger than the disk or a limit allows",
    errno.ENAMETOOLONG: "the name is too long",
}


def reason_of(error: OSError) -> str:
    """Why the operating system refused, in words; never empty."""
    return _REASONS.get(error.errno or 0) or error.strerror or type(error).__name__


def text_of(error: OSError) -> str:
    """The file, where the system names it, and why it refused."""
    message = reason_of(error)
    return message if error.filename in (None, "") else f"{error.filename}: {message}"


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
            f"{path}: cannot be written ({reason_of(error)}); expected a writable path"
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_whole(path: Path, chunks: Iterable[bytes]) -> None:
    """Write ``chunks`` to ``path`` as `replacing` does."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.writelines(chunks)


def write_together(contents: Mapping[Path, str | bytes]) -> None:
    """Write several files, texts as UTF-8. If a kill leaves only some, `cut_short` sees it.

    All are complete beside their places before the first takes its place. Raises FileError if one
    cannot be written.
    """
    with ExitStack() as stack:
        for path, content in contents.items():
            raw = content.encode() if isinstance(content, str) else content
            stack.enter_context(replacing(path)).write_bytes(raw)


def cut_short(paths: Iterable[Path]) -> bool:
    """Whether a killed `write_together` of these files left only some of them."""
    return any(part_of(path).exists() for path in paths)
