"""Reads one scan from a .bin, .npy, .pcd or .ply file, and lists the scan files of folders."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deepring.data.readers import binary_formats
from deepring.data.scans.bag_files import BAGS, is_bag
from deepring.data.scans.ply import read_ply
from deepring.data.scans.returns import scan_from
from deepring.data.session import Points
from deepring.errors import BrokenScanError, ConfigError, DeepringError, FileError


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
        FileError: a missing file, one of another type, or a library that is not installed.
        ConfigError: a .bin file without its format.
    """
    path = Path(path)
    if not path.is_file():
        raise FileError(f"scan {path}: no such file")
    if path.suffix == ".bin":
        formats = binary_formats()
        if binary not in formats:
            raise ConfigError(
                f"scan {path}: a .bin file does not contain its format; name it, one of "
                f"{', '.join(formats)}",
                argument="binary",
            )
        return formats[binary].read(path)
    if path.suffix not in _READERS:
        raise FileError(
            f"scan {path}: unknown ending {path.suffix!r}, expected .bin, {', '.join(_READERS)}"
        )
    try:
        points = np.asarray(_READERS[path.suffix](path))
    except DeepringError:
        raise
    except Exception as error:  # libraries raise many types for a damaged file
        raise BrokenScanError(
            f"scan {path}: cannot be decoded; expected a complete {path.suffix} file, but this one "
            "is damaged, cut short or of another type"
        ) from error
    if points.ndim != 2 or points.shape[1] < 3 or points.dtype.kind not in "fiu":
        raise BrokenScanError(
            f"scan {path}: an array of shape {points.shape} and type {points.dtype}; expected "
            "numbers (n, 3) or wider, x, y and z first"
        )
    with np.errstate(over="ignore"):  # beyond float32 becomes infinite
        return np.ascontiguousarray(points[:, :3], dtype=np.float32)


def scan_files(paths: Sequence[Path]) -> list[Path]:
    """The given files, and the scan files and bags of the given folders, sorted by name.

    A folder that is itself a bag counts as a file. Raises FileError for a missing path or a folder
    without scans.
    """
    endings = {".bin", *_READERS, *BAGS}
    files: list[Path] = []
    for path in paths:
        if path.is_dir() and not is_bag(path):
            inside = sorted(file for file in path.iterdir() if file.suffix in endings)
            if not inside:
                raise FileError(
                    f"{path}: a folder without scans; expected files ending in "
                    f"{', '.join(sorted(endings))}"
                )
            files += inside
        elif path.exists():
            files.append(path)
        else:
            raise FileError(f"{path}: no such file or folder; expected scans")
    return files


def _read_npy(path: Path) -> Any:
    return np.load(path, allow_pickle=False)


def _read_pcd(path: Path) -> Any:
    try:
        from pypcd4 import PointCloud  # type: ignore[attr-defined]
    except ImportError as error:
        raise FileError(
            f"scan {path}: .pcd files need pypcd4; pip install 'deepring[scans]'"
        ) from error
    return PointCloud.from_path(path).numpy(("x", "y", "z"))


_READERS: dict[str, Callable[[Path], Any]] = {
    ".npy": _read_npy,
    ".pcd": _read_pcd,
    ".ply": read_ply,
}
