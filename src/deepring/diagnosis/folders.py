"""The folders that commands write to: whether they can, how much is there, how much is free."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from deepring.diagnosis.trouble import Trouble
from deepring.io.files import reason_of

#: Free bytes without which files of a run cannot be written, and below which they run short.
_NONE_FREE, _FEW_FREE = 50e6, 2e9

#: File systems on a network, on which SQLite may lose its locks.
_ON_NETWORK = (
    "nfs",
    "nfs4",
    "cifs",
    "smb3",
    "smbfs",
    "fuse.sshfs",
    "lustre",
    "gpfs",
    "beegfs",
    "9p",
)


@dataclass(frozen=True)
class Folder:
    """One folder."""

    what: str
    path: Path
    exists: bool
    unwritable: str
    """Why nothing can be written there; empty where it can."""
    bytes: int
    """Of the files in it."""
    free: int | None
    """Bytes that are free on its disk."""
    file_system: str
    """As the system names it; empty where it does not."""

    def troubles(self) -> Iterator[Trouble]:
        """What keeps commands from writing there."""
        if self.unwritable:
            yield Trouble(
                "folders",
                f"{self.what}: nothing can be written in {self.path}: {self.unwritable}",
                _ADVICE[self.what],
                self.what != COMPILED,
            )
        if self.free is not None and self.free < _FEW_FREE:
            yield Trouble(
                "folders",
                f"{self.what}: {self.free / 1e6:.0f} MB are free on the disk of {self.path}",
                "make room; a training writes some 100 MB, a simulated dataset 300",
                self.free < _NONE_FREE,
            )
        if self.what == CACHE and self.file_system in _ON_NETWORK:
            yield Trouble(
                "folders",
                f"{self.what}: {self.path} lies on a network ({self.file_system}), where the "
                "database of the cache is slow and may be damaged by several processes",
                "give paths.cache=FOLDER on a local disk",
            )


CACHE, COMPILED, TEMPORARY, WORKING = "cache", "compiled loops", "temporary", "working folder"

_ADVICE = {
    CACHE: "give paths.cache=FOLDER, or start in another folder",
    COMPILED: "set NUMBA_CACHE_DIR to a folder that can be written, or each start compiles them",
    TEMPORARY: "set TMPDIR to a folder that can be written",
    WORKING: "start in another folder, or name outputs elsewhere",
}


def find_folders(cache: Path) -> list[Folder]:
    """The folders of the raster cache, of compiled loops, of temporary files, and this one."""
    return [
        _folder(CACHE, cache),
        _folder(COMPILED, compiled_folder()),
        _folder(TEMPORARY, Path(tempfile.gettempdir()), sized=False),
        _folder(WORKING, Path.cwd(), sized=False),
    ]


def compiled_folder() -> Path:
    """Where numba keeps the compiled loops: beside the package, or where it may write."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    if named:
        return Path(named)
    beside = Path(__file__).resolve().parents[1]
    if not _unwritable(beside):
        return beside
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"


def _folder(what: str, path: Path, *, sized: bool = True) -> Folder:
    above = _existing(path)
    pattern = "*.nb[ic]" if what == COMPILED else "*"
    try:
        size = sum(file.stat().st_size for file in path.rglob(pattern)) if sized else 0
    except OSError:
        size = 0
    try:
        free = shutil.disk_usage(above).free
    except OSError:
        free = None
    return Folder(what, path, path.is_dir(), _unwritable(above), size, free, _file_system(above))


def _existing(path: Path) -> Path:
    """The folder, or the nearest one above it that exists."""
    path = path.absolute()
    while not path.exists() and path != path.parent:
        path = path.parent
    return path


def _unwritable(folder: Path) -> str:
    """Why no file can be made there; empty if one can. Nothing is left behind."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"0")
    except OSError as error:
        return reason_of(error)
    return ""


def _file_system(folder: Path) -> str:
    """The kind of the file system that holds a folder."""
    try:
        lines = Path("/proc/self/mounts").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    best, kind = -1, ""
    for fields in map(str.split, lines):
        mount = fields[1].replace(r"\040", " ")
        if folder.is_relative_to(mount) and len(mount) >= best:
            best, kind = len(mount), fields[2]
    return kind
