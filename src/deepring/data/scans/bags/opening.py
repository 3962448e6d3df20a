"""Opens a bag, a file or a folder of them, and lists what it holds."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from deepring.data.scans.bags.compression import decompress_file
from deepring.data.scans.bags.database_file import DatabaseFile
from deepring.data.scans.bags.folder import read_folder
from deepring.data.scans.bags.mcap_file import McapFile
from deepring.data.scans.bags.ros1_file import Ros1File
from deepring.data.scans.bags.storage import Container, Contents
from deepring.data.scans.bags.topics import Topics, topics_of
from deepring.data.scans.names import ending_of
from deepring.errors import BrokenScanError, DataError, FileError
from deepring.io.git_lfs import LFS_POINTER, is_lfs_pointer_file

#: How a file is read, by its ending.
CONTAINERS: dict[str, Callable[[Path], Container]] = {
    ".bag": Ros1File,
    ".db3": DatabaseFile,
    ".mcap": McapFile,
}


class Part(NamedTuple):
    """One file of a bag."""

    file: Container
    contents: Contents


class Bag(NamedTuple):
    """The files of a bag in their order."""

    parts: list[Part]
    topics: Topics
    """By the files' own indexes, or by metadata.yaml where that says more."""
    counted: bool
    """Whether ``topics`` has all messages; not so if an index is damaged."""


def open_bag(path: Path, opened: ExitStack) -> Bag:
    """The bag at ``path``; ``opened`` removes what was decompressed for it.

    Raises BrokenScanError, DataError and FileError without the name of the bag.
    """
    if not path.is_dir():
        if ending_of(path) not in CONTAINERS:
            raise FileError(f"expected an ending {', '.join(CONTAINERS)}, or a folder")
        if is_lfs_pointer_file(path):
            raise BrokenScanError(LFS_POINTER)
        part = _part(path)
        return Bag([part], topics_of([part.contents]), not part.contents.damage)
    if not (path / "metadata.yaml").is_file():
        raise FileError("no metadata.yaml in the folder; `ros2 bag reindex` makes it")
    folder = read_folder(path)
    files = folder.files
    for file in files:
        if is_lfs_pointer_file(file):
            raise BrokenScanError(f"{file.name} {LFS_POINTER}")
    if folder.compressed:
        into = Path(opened.enter_context(TemporaryDirectory()))
        files = [_decompressed(file, into / file.stem) for file in files]
    parts = [_part(file) for file in files]
    found = topics_of(part.contents for part in parts)
    names = {*found, *folder.counts}
    topics = {name: max(found.get(name, 0), folder.counts.get(name, 0)) for name in names}
    return Bag(parts, topics, True)


def _part(file: Path) -> Part:
    container = CONTAINERS[ending_of(file)](file)
    try:
        return Part(container, container.contents())
    except BrokenScanError as error:
        raise BrokenScanError(f"{error}. {advice(container)}") from error


def _decompressed(source: Path, target: Path) -> Path:
    try:
        decompress_file(source, target)
    except (BrokenScanError, DataError) as error:
        raise type(error)(f"{source.name}: {error}") from error
    return target


def advice(container: Container) -> str:
    """What to do about a damaged file."""
    repair = container.repair.replace("FILE", container.path.name)
    return f"It is damaged, cut short or was not closed: copy it again, or try `{repair}`"
