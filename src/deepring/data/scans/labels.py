"""The class of each point of a scan, from the file beside it, as SemanticKITTI has them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.columns import PointColumn, Values, label_path
from deepring.data.scans.content import content_of
from deepring.errors import BrokenScanError
from deepring.io.files import write_whole

_LABEL = np.dtype("<u4")  # class in the low 16 bits, number of the instance above


def read_labels(scan: Path) -> NDArray[np.uint16]:
    """The classes (n,) of a scan's records, in the order of its file.

    Numbers are uint32, little-endian; instances, in the high 16 bits, are left out. Raises
    BrokenScanError for a missing file, and for one that has another size.
    """
    path = label_path(scan)
    if not path.is_file():
        raise BrokenScanError(f"{scan}: no labels: {path} is missing; expected one file a scan")
    content = content_of(path)
    if len(content) % _LABEL.itemsize:
        raise BrokenScanError(
            f"{path}: {len(content)} bytes; expected a multiple of 4, the size of one label"
        )
    classes: NDArray[np.uint16] = np.frombuffer(content, _LABEL).astype(np.uint16)
    return classes


def write_labels(scan: Path, labels: NDArray[np.uint16]) -> None:
    """Write the classes (n,) of a scan's points, in the order of its file, as uint32."""
    write_whole(label_path(scan), [labels.astype(_LABEL).tobytes()])


def point_columns(
    scans: Sequence[Path], intensity: Values | None = None, labels: Values = read_labels
) -> Mapping[str, PointColumn]:
    """The columns that the scans of one folder have, by name.

    ``intensity`` is in the unit of the files. ``label``, the class, is there if the folder of the
    labels is; its numbers are those of the dataset.
    """
    columns = {} if intensity is None else {"intensity": PointColumn(intensity)}
    if scans and label_path(scans[0]).parent.is_dir():
        columns["label"] = PointColumn(labels, label_path)
    return columns
