"""Whether poses by stamps, which are given beside scans, can be those of a drive."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.data.inspection.finding import Finding
from deepring.data.inspection.poses import pose_findings, step_findings
from deepring.data.poses.trajectory import Trajectory
from deepring.data.session import Points, Session
from deepring.errors import DataError


def expect_drive(file: Path, trajectory: Trajectory, *, any_world: bool = False) -> list[Finding]:
    """Doubts about a file's poses of a sensor, world <- scan: their unit, axes and motion.

    With ``any_world`` the steps between poses alone are looked at. Raises DataError, with what to
    change, for poses that are plausible only if their numbers are read in another way.
    """
    session = Session(
        file.name,
        tuple(Path(f"row {row + 1}") for row in range(len(trajectory))),
        trajectory.poses,
        trajectory.poses[:, :2, 3],
        trajectory.stamps,
        _no_scan,
    )
    if any_world:
        return step_findings(session)
    findings = pose_findings(session)
    unusable = [str(finding) for finding in findings if finding.unusable]
    if unusable:
        raise DataError(f"{file} cannot be used: {'. '.join(unusable)}", argument="poses")
    return findings


def _no_scan(_: Path) -> Points:
    empty: NDArray[np.float32] = np.empty((0, 3), dtype=np.float32)
    return empty
