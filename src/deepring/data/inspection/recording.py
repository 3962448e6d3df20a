"""Whether the scans of a recording can be used, and where the ground is in them."""

from itertools import islice

import numpy as np

from deepring.data.inspection.figures import measure_scan
from deepring.data.inspection.finding import Finding
from deepring.data.inspection.scans import figure_findings, shows_ground
from deepring.data.inspection.session_scans import usual_figures
from deepring.data.recording import Recording
from deepring.errors import BrokenScanError, DataError

#: Scans at the beginning of a recording that are inspected.
SAMPLE = 12
#: Metres by which the ground of the sample may vary, half of it to each side, to be taken from it.
MOST_VARYING = 0.5
#: Metres. No sensor sees surroundings whose ground is not as far below it.
HIGHEST = -0.2


def inspect_recording(
    recording: Recording, ground_z: float | None = None
) -> tuple[float, list[Finding]]:
    """z of the ground in the scans' frame, metres, and the doubts about the first scans.

    The ground is ``ground_z``, or the recording's own, or where the first scans show it: the median
    of those in which most of the surroundings agree on it.

    Raises:
        DataError: scans that cannot be used, none that can be read, or whose ground is not known
            and not shown.
    """
    known = recording.ground_z if ground_z is None else ground_z
    figures = []
    try:
        for scan in islice(iter(recording), SAMPLE):
            try:
                figures.append(measure_scan(scan.read().points))
            except BrokenScanError as error:
                first = str(error)
    except BrokenScanError as error:  # a bag that is damaged behind them
        first = str(error)
    what = f"session {recording.name}"
    if not figures:
        raise DataError(f"{what}: none of its first scans can be read; first: {first}")
    usual = usual_figures(figures)
    findings = figure_findings(usual, known)
    unusable = [str(finding) for finding in findings if finding.unusable]
    if unusable:
        raise DataError(f"{what} cannot be used: {'. '.join(unusable)}")
    if known is not None:
        return known, findings
    showing = [one.ground for one in figures if shows_ground(one)]
    agree = 2 * len(showing) >= len(figures)
    if agree:
        agree = bool(np.ptp(np.quantile(showing, [0.1, 0.9])) <= MOST_VARYING)
    if not agree or np.median(showing) > HIGHEST:
        raise DataError(
            "ground_z: not given, and the first scans do not show it; expected z of the ground "
            "under the sensor in the scans' frame, metres: minus the height of the sensor"
        )
    return round(float(np.median(showing)), 2), findings
