"""Further columns of a scan's points: a class, an intensity."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

Values = Callable[[Path], NDArray[Any]]
"""Reads one number (n,) for each record of a scan file, in the order of the session's ``read``."""


@dataclass(frozen=True)
class PointColumn:
    """One value of each point, beside its coordinates."""

    read: Values
    """Raises BrokenScanError for a file that cannot be decoded."""
    file: Callable[[Path], Path] | None = None
    """The file beside a scan that holds the values; None if the scan holds them."""


def label_path(scan: Path) -> Path:
    """The file of a scan's labels: ``labels/NAME.label`` beside the folder of the scans."""
    return scan.parent.parent / "labels" / f"{scan.stem}.label"
