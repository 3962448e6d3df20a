"""A refined pose in the rows of `deepring localize --refine`: in a table, JSON and CSV."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from deepring.localization.refined_pose import RefinedPose

#: Columns of the table in place of those of a location, lengths above angles, so that a row fits
#: 80 columns; and what CSV adds to those of a location.
TABLE = ("x m\nroll °", "y m\npitch °", "z m\nyaw °", "± m\n± °", "inliers")
CSV = (
    *(f"refined_{name}" for name in ("x", "y", "z", "roll", "pitch", "yaw")),
    "refined_covariance",
    "unobservable",
    "inliers",
    "converged",
    "refined_doubt",
)


def json_values(refined: RefinedPose) -> dict[str, Any]:
    """What JSON says of a refined pose; matrices as lists of their rows."""
    return {
        "pose": refined.pose.tolist(),
        "covariance": refined.covariance.tolist(),
        "unobservable": [
            {"name": name, "direction": direction.tolist()}
            for name, direction in zip(
                refined.unobservable_names, refined.unobservable, strict=True
            )
        ],
        "inliers": refined.inliers,
        "converged": refined.converged,
        "doubt": refined.doubt,
    }


def csv_values(refined: RefinedPose) -> Mapping[str, Any]:
    """The columns `CSV`; the covariance is 36 numbers, row by row, between spaces."""
    position = (refined.x, refined.y, refined.z)
    covariance = " ".join(f"{value:.9g}" for value in refined.covariance.ravel())
    names = "; ".join(refined.unobservable_names)
    doubts = (refined.inliers, refined.converged, refined.doubt)
    values = (*position, *refined.roll_pitch_yaw, covariance, names, *doubts)
    return dict(zip(CSV, values, strict=True))


def table_cells(refined: RefinedPose) -> list[str]:
    """The columns `TABLE`; ± is the standard deviation along the worst direction."""
    position = (refined.x, refined.y, refined.z)
    angles = map(math.degrees, refined.roll_pitch_yaw)
    shift, turn = (
        math.sqrt(float(np.linalg.eigvalsh(refined.covariance[part, part])[-1]))
        for part in (slice(0, 3), slice(3, 6))
    )
    return [
        *(f"{metres:.2f}\n{degrees:.2f}" for metres, degrees in zip(position, angles, strict=True)),
        f"{shift:.2g}\n{math.degrees(turn):.2g}",
        f"{refined.inliers:.2f}",
    ]


def table_notes(refined: RefinedPose) -> list[str]:
    """What the table says beside the trust in the location."""
    doubtful = refined.doubt not in (None, "location")
    notes = [f"pose: {refined.doubt}"] if doubtful else []
    names = refined.unobservable_names if refined.converged else []
    return notes + ([f"unobservable: {', '.join(names)}"] if names else [])
