"""The class of each point beside a scan, as SemanticKITTI's label files have it."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.io.files import write_whole


def label_path(scan: Path) -> Path:
    """The file of a scan's labels: ``labels/NAME.label`` beside the folder of the scans."""
    return scan.parent.parent / "labels" / f"{scan.stem}.label"


def write_labels(scan: Path, labels: NDArray[np.uint16]) -> None:
    """Write the classes (n,) of a scan's points, in the order of its file, as uint32."""
    write_whole(label_path(scan), [labels.astype("<u4").tobytes()])
