"""Reads one scan from a .bin, .npy, .pcd or .ply file, and lists the scan files of folders."""

from collections.abc import Callable, Sequence
from pathlib import Path

from deepring.data.readers import binary_formats
from deepring.data.scans.bag_files import BAGS, is_bag
from deepring.data.scans.content import content_of
from deepring.data.scans.names import ending_of, files_with
from deepring.data.scans.npy import read_npy
from deepring.data.scans.pcd import read_pcd
from deepring.data.scans.ply import read_ply
from deepring.data.scans.returns import scan_from
from deepring.data.session import Points
from deepring.errors import ConfigError, FileError

_READERS: dict[str, Callable[[Path], Points]] = {
    ".npy": read_npy,
    ".pcd": read_pcd,
    ".ply": read_ply,
}
#: Endings of files that contain one scan; upper case is taken, too.
SCANS = (".bin", *_READERS)

_ENDINGS = sorted((*SCANS, *BAGS))


def read_scan(path: Path | str, binary: str | None = None) -> Points:
    """Points (n, 3) float32, metres, of a .npy, .pcd, .ply or .bin file.

    ``binary`` is the format of a .bin file, one of `binary_formats`. Missing returns are dropped:
    NaN, infinite and (0, 0, 0).

    Raises:
        BrokenScanError: a file that cannot be decoded, or has no point.
        FileError, ConfigError: see `scan_records`.
    """
    return scan_from(scan_records(path, binary), path).points


def scan_records(path: Path | str, binary: str | None = None) -> Points:
    """The records (n, 3) float32 of a file, as `read_scan`, with missing returns.

    Raises:
        BrokenScanError: a file that cannot be decoded.
        FileError: a missing file, or one of another type.
        ConfigError: a .bin file without its format.
    """
    path = Path(path)
    if not path.is_file():
        raise FileError(f"scan {path}: no such file")
    ending = ending_of(path)
    if ending not in SCANS:
        raise FileError(f"scan {path}: unknown ending {path.suffix!r}, expected {', '.join(SCANS)}")
    if ending != ".bin":
        return _READERS[ending](path)
    formats = binary_formats()
    if binary not in formats:
        content_of(path)  # what is no scan in any format says so first
        raise ConfigError(
            f"scan {path}: a .bin file does not contain its format; name it, one of "
            f"{', '.join(formats)}",
            argument="binary",
        )
    return formats[binary].read(path)


def holds_scans(folder: Path) -> bool:
    """Whether files of scans or bags lie in a folder itself."""
    return bool(files_with(folder, _ENDINGS))


def scan_files(paths: Sequence[Path], every: int = 1) -> list[Path]:
    """The given files, and the scan files and bags of the given folders.

    A folder's files are in the order of the numbers in their names; hidden ones are left out, and
    of its scans every ``every``-th is taken. A folder that is itself a bag counts as a file. Raises
    FileError for a missing path or a folder without scans.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir() and not is_bag(path):
            inside = files_with(path, _ENDINGS)
            if not inside:
                expected = ", ".join(_ENDINGS)
                raise FileError(
                    f"{path}: a folder without scans; expected files ending in {expected}"
                )
            taken = {*[file for file in inside if not is_bag(file)][::every]}
            files += [file for file in inside if file in taken or is_bag(file)]
        elif path.exists():
            files.append(path)
        else:
            raise FileError(f"{path}: no such file or folder; expected scans")
    return files
