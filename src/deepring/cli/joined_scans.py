"""`deepring localize --accumulate`: scans joined with those before them."""

from pathlib import Path

from deepring.data.scans.point_times import TimedPoints
from deepring.data.session import Points
from deepring.localization.accumulation import Accumulator
from deepring.localization.drives.odometry import kiss_icp


class JoinedScans:
    """Joins up to ``count`` scans of one sequence: a bag, a drive or a folder.

    Raises ConfigError for more than one where kiss-icp is not installed.
    """

    def __init__(self, count: int) -> None:
        self.count, self.interruptions = count, 0
        self._accumulators: dict[Path, Accumulator] = {}
        if count > 1:
            kiss_icp()

    def points(self, sequence: Path, scan: TimedPoints, stamp: int | None) -> Points:
        """The points of a scan, and of those before it in its frame."""
        if self.count == 1:
            return scan.points
        if sequence not in self._accumulators:  # scans of another sequence come no more
            self._accumulators = {sequence: Accumulator(self.count)}
        accumulator = self._accumulators[sequence]
        before = accumulator.interruptions
        points = accumulator.join(scan, stamp)
        self.interruptions += accumulator.interruptions - before
        return points

    def warning(self) -> str:
        """That some scans did not follow each other; empty if all did."""
        if not self.interruptions:
            return ""
        return (
            f"--accumulate: {self.interruptions} scans do not overlap enough with those before "
            "them, and were joined with none; give scans in order, 10 a second or one a metre"
        )
