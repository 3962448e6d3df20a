"""The reports of a dataset check as JSON; docs/datasets.md states the keys."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from deepring.data.inspection.check import SessionReport
from deepring.io.stated_json import json_text


def report_json(root: Path | str, reports: Sequence[SessionReport], status: int) -> str:
    """One object with the folder, the exit status and the sessions. Lengths are in metres."""
    content = {
        "root": str(root),
        "status": status,
        "sessions": [_session(report) for report in reports],
    }
    return json_text("dataset_check", content)


def _session(report: SessionReport) -> dict[str, Any]:
    figures = report.figures
    keys = ("missing", "distance", "span_x", "span_y", "span_z")
    return {
        "name": report.name,
        "format": report.format,
        "verdict": report.verdict,
        "problem": report.problem,
        "scans": report.scans,
        "readable": report.readable,
        "without_pose": report.without_pose,
        "bad_poses": report.bad_poses,
        "broken": list(report.broken),
        "span_s": _number(report.span_s),
        "time_gaps": None if report.time_gaps is None else asdict(report.time_gaps),
        "repeated_stamps": report.repeated_stamps,
        "path_m": _number(report.path_m),
        "jumps": {"count": report.jumps.count, "largest": _number(report.jumps.largest)},
        "points": None
        if report.points is None
        else dict(zip(("min", "median", "max"), report.points, strict=True)),
        **{key: None if figures is None else _number(getattr(figures, key)) for key in keys},
        "ground_z": _number(report.ground_z),
        "ground_found": _number(report.ground_found),
        "overlay": report.overlay,
        "findings": [asdict(finding) for finding in report.findings],
    }


def _number(value: float | None) -> float | None:
    """JSON has no NaN and no infinity."""
    return None if value is None or not math.isfinite(value) else float(value)
