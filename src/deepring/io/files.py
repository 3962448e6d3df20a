"""Files that appear whole or not at all."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from deepring.errors import DeepringError

if TYPE_CHECKING:
    from torch import Tensor


def part_of(path: Path) -> Path:
    """The hidden file that holds ``path``'s content until it is whole."""
    return path.with_name(f".{path.name}.part")


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """A temporary path beside ``path`` to write to; put in its place in one step at the end.

    Folders are made as needed. Where the block raises, ``path`` stays as it was; a process that
    is killed leaves at most a hidden ``.<name>.part``, which the next one replaces. Raises
    DeepringError where the file cannot be written.
    """
    path = Path(path)
    temporary = part_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise DeepringError(f"{path}: {error}; expected a path to write to") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_tensors(path: Path, tensors: Mapping[str, "Tensor"], metadata: Mapping[str, str]) -> None:
    """Write a safetensors file as `replacing` does, with a new file's usual permissions."""
    from safetensors.torch import save_file

    whole = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with replacing(path) as temporary:
        temporary.touch()
        usual = temporary.stat().st_mode
        save_file(whole, temporary, dict(metadata))
        temporary.chmod(usual)  # safetensors leaves it to its owner alone


def write_whole(path: Path, chunks: Iterable[bytes]) -> None:
    """Write ``chunks`` to ``path`` as `replacing` does."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.writelines(chunks)
