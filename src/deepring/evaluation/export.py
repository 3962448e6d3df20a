"""Writing what an evaluation has described: the two descriptor files of a method on a test."""

from pathlib import Path
from typing import get_args

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
from deepring.methods.base import Method


class Export:
    """Both sides in the making; what would fail after the work fails before it.

    Raises ConfigError for a method whose `fingerprint` cannot be taken, and FileError where a file
    of the name holds something else.
    """

    def __init__(self, folder: Path, case: Case, method: Method) -> None:
        self.case = case
        self.made_by = fingerprint(method)
        self.paths = {side: free_path(folder, case, side) for side in get_args(SideName)}
        self.sides: list[DescriptorSet] = []

    def add(self, side: SideName, scans: ScanSet, descriptors: Tensor, per_scan: float) -> None:
        """Take the descriptors (n, ...) of a side.

        ``per_scan`` is the seconds from points to descriptor.

        Raises DataError for descriptors that a file cannot hold.
        """
        self.sides.append(
            DescriptorSet(
                descriptors=descriptors.detach().cpu().numpy(),
                positions=scans.positions,
                indices=scans.indices,
                turns=scans.turns,
                **self.case.columns,
                side=side,
                session=scans.session.name,
                made_by=self.made_by,
                ground_z=float(scans.ground_z),
                seconds_per_scan=per_scan,
            )
        )

    def write(self) -> None:
        """Write the sides that were taken. Raises FileError where that cannot be."""
        for side in self.sides:
            write_descriptors(self.paths[side.side], side)
