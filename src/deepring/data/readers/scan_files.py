"""One scan from a file of whatever kind: what a robot has lying about."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deepring.data.readers.bag_files import BAGS, is_bag
from deepring.data.readers.kitti import read_kitti_scan
from deepring.data.readers.mulran import read_mulran_scan
from deepring.data.readers.nclt import read_nclt_scan
from deepring.data.session import Points
from deepring.errors import BrokenScanError, DeepringError

#: Readers of .bin files, which do not say what is in them.
BINARY: dict[str, Callable[[Path | str], Points]] = {
    "nclt": read_nclt_scan,
    "mulran": read_mulran_scan,
    "kitti": read_kitti_scan,
}

_INSTALL = "pip install 'deepring[scans]'"


def read_scan(path: Path | str, binary: str | None = None) -> Points:
    """Points (n, 3) float32, metres, of a .npy, .pcd, .ply or .bin file.

    ``binary`` says what a .bin file holds: 'nclt', 'mulran' or 'kitti'. Points without
    coordinates, as organised clouds have them for beams without a return, are kept as they are.

    Raises:
        BrokenScanError: a file that cannot be decoded.
        DeepringError: a missing file, another kind, a .bin file of unknown content.
    """
    path = Path(path)
    if not path.is_file():
        raise DeepringError(f"scan {path}: no such file")
    if path.suffix == ".bin":
        if binary not in BINARY:
            raise DeepringError(
                f"scan {path}: a .bin file does not say what is in it; name its format, "
                f"{', '.join(BINARY)} (--format)"
            )
        return BINARY[binary](path)
    readers = {".npy": _read_npy, ".pcd": _read_pcd, ".ply": _read_ply}
    if path.suffix not in readers:
        raise DeepringError(
            f"scan {path}: files ending in {path.suffix!r} are not known; expected .bin, "
            f"{', '.join(readers)}"
        )
    try:
        points = np.asarray(readers[path.suffix](path))
    except ImportError as error:
        raise DeepringError(f"scan {path}: {error}; {_INSTALL}") from error
    except DeepringError:
        raise
    except Exception as error:  # whatever a library raises for a damaged file
        raise BrokenScanError(f"scan {path}: {error}; cannot be read") from error
    if points.ndim != 2 or points.shape[1] < 3 or points.dtype.kind not in "fiu":
        raise BrokenScanError(
            f"scan {path}: an array of shape {points.shape} and type {points.dtype}; expected "
            "numbers (n, 3) or wider, x, y and z first"
        )
    return np.ascontiguousarray(points[:, :3], dtype=np.float32)


def scan_files(paths: Sequence[Path]) -> list[Path]:
    """The files named, and those of the folders named in the order of their names.

    Bags are among them; a folder that is one stands for itself.

    Raises DeepringError for a path that is not there, and for a folder without scans.
    """
    endings = {".bin", ".npy", ".pcd", ".ply", *BAGS}
    found: list[Path] = []
    for path in paths:
        if path.is_dir() and not is_bag(path):
            inside = sorted(file for file in path.iterdir() if file.suffix in endings)
            if not inside:
                raise DeepringError(
                    f"{path}: a folder without scans; expected files ending in "
                    f"{', '.join(sorted(endings))}"
                )
            found += inside
        elif path.exists():
            found.append(path)
        else:
            raise DeepringError(f"{path}: no such file or folder; expected scans")
    return found


def _read_npy(path: Path) -> Any:
    return np.load(path, allow_pickle=False)


def _read_pcd(path: Path) -> Any:
    from pypcd4 import PointCloud  # type: ignore[attr-defined]

    return PointCloud.from_path(path).numpy(("x", "y", "z"))


def _read_ply(path: Path) -> Any:
    import trimesh

    loaded: Any = trimesh.load(path)
    return np.asarray(loaded.vertices)
