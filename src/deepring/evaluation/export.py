"""Export of descriptors: the two files of a method on a retrieval task."""

from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from deepring.data.scan_set import ScanSet
from deepring.evaluation.case import Case
from deepring.evaluation.descriptors import (
    DescriptorSet,
    SideName,
    free_path,
    write_descriptors,
)
from deepring.evaluation.fingerprint import fingerprint
from deepring.methods.method import Method


class Export:
    """Collects the descriptors of both sides; checks paths and fingerprint first.

    Raises DataError for a method without a `fingerprint`, and FileError if a file of this name
    holds something else.
    """

    def __init__(self, folder: Path, case: Case, method: Method) -> None:
        self.case = case
        self.made_by = fingerprint(method)
        self.paths = {side: free_path(folder, case, side) for side in get_args(SideName)}
        self.sides: list[DescriptorSet] = []

    def add(
        self,
        side: SideName,
        scans: ScanSet,
        descriptors: Tensor,
        per_scan: float,
        before: NDArray[np.int64] | None = None,
    ) -> None:
        """Add the descriptors (n, ...) of a side.

        ``per_scan`` is the seconds from points to descriptor, ``before`` that of the
        `RetrievalSet`.

        Raises DataError for descriptors that a file cannot hold.
        """
        self.sides.append(
            DescriptorSet(
                descriptors=descriptors.detach().cpu().numpy(),
                positions=scans.positions,
                indices=scans.indices,
                turns=scans.turns,
                before=before,
                case=self.case,
                side=side,
                session=scans.session.name,
                made_by=self.made_by,
                ground_z=float(scans.ground_z),
                seconds_per_scan=per_scan,
            )
        )

    def write(self) -> None:
        """Write all sides. Raises FileError if a file cannot be written."""
        for side in self.sides:
            write_descriptors(self.paths[side.side], side)
