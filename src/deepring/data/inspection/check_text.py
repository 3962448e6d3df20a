"""The reports of a dataset check as plain text, at most 100 columns wide where names are short."""

import textwrap
from collections.abc import Iterator, Sequence

from deepring.data.inspection.check import JUMP_M, TIME_GAP_S, Gaps, SessionReport

MOST_BROKEN = 5  # broken files listed per session
WIDTH = 96

_VERDICTS = {
    "good": "nothing doubtful",
    "doubtful": "doubtful: results may be wrong",
    "unusable": "cannot be used: results would be wrong",
}


def report_lines(reports: Sequence[SessionReport]) -> list[str]:
    """Lines of a table with one row per session, then what was read and found in each."""
    header = ("session", "scans", "no pose", "broken", "bad poses", "time", "path", "points/scan")
    rows = [header, *(_row(report) for report in reports)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(header))]
    lines = [_aligned(row, widths) for row in rows]
    lines.insert(1, "  ".join("-" * width for width in widths))
    for report in reports:
        lines += ["", *_details(report)]
    return lines


def _aligned(row: Sequence[str], widths: Sequence[int]) -> str:
    name, *numbers = (
        cell.ljust(width) if column == 0 else cell.rjust(width)
        for column, (cell, width) in enumerate(zip(row, widths, strict=True))
    )
    return "  ".join([name, *numbers]).rstrip()


def _row(report: SessionReport) -> tuple[str, ...]:
    if report.problem is not None:
        return (report.name, *["-"] * 7)
    points = "-"
    if report.points is not None:
        low, median, high = report.points
        points = f"{low} / {median:.0f} / {high}"
    return (
        report.name,
        str(report.scans),
        str(report.without_pose),
        str(len(report.broken)),
        str(report.bad_poses),
        "-" if report.span_s is None else f"{report.span_s:.1f} s",
        f"{report.path_m:.0f} m",
        points,
    )


def _details(report: SessionReport) -> Iterator[str]:
    """What was read, broken files, and what is doubted, with advice."""
    yield f"{report.name} ({report.format}): {_VERDICTS[report.verdict]}"
    if report.problem is not None:
        yield from _labelled("unusable", f"cannot be opened: {report.problem}")
        return
    for label, text in _facts(report):
        yield from _labelled(label, text)
    for reason in report.broken[1:MOST_BROKEN]:  # the first is a finding
        yield from _labelled("broken", reason)
    if len(report.broken) > MOST_BROKEN:
        yield from _labelled("broken", f"... and {len(report.broken) - MOST_BROKEN} more files")
    for finding in report.findings:
        label = "unusable" if finding.unusable else "doubt"
        yield from _labelled(label, f"{finding.subject}: {finding.found}")
        yield from _labelled("", f"-> {finding.advice}")


def _facts(report: SessionReport) -> Iterator[tuple[str, str]]:
    figures = report.figures
    if figures is not None and figures.points:
        yield (
            "points",
            f"{figures.missing:.0%} of the records miss a return; half within "
            f"{figures.distance:.4g} m; the middle 90 % span {figures.span_x:.3g} m in x, "
            f"{figures.span_y:.3g} m in y, {figures.span_z:.3g} m in z",
        )
        ground = report.ground_found
        shown = "not clearly seen" if ground is None else f"at z = {ground:.2f} m"
        expected = "not known" if report.ground_z is None else f"{report.ground_z:.2f} m"
        yield "ground", f"{shown}, expected {expected}"
    if report.overlay and all(finding.found != report.overlay for finding in report.findings):
        yield "poses", report.overlay
    if report.time_gaps is not None and report.time_gaps.count:
        yield "time", f"{_steps(report.time_gaps, 'gap', TIME_GAP_S, 's')}"
    if report.repeated_stamps:
        yield "time", f"{report.repeated_stamps} stamps equal to the one before"
    if report.jumps.count:
        yield "path", _steps(report.jumps, "jump", JUMP_M, "m")


def _steps(gaps: Gaps, name: str, limit: float, unit: str) -> str:
    plural = "" if gaps.count == 1 else "s"
    return f"{gaps.count} {name}{plural} > {limit:g} {unit}, the largest {gaps.largest:.1f} {unit}"


def _labelled(label: str, text: str) -> list[str]:
    """Text behind a label, wrapped; lines of the text stay lines, long names stay whole."""
    lines: list[str] = []
    for line in text.splitlines():
        first = f"  {label:<9}" if not lines else " " * 11
        lines += textwrap.wrap(
            line,
            WIDTH,
            initial_indent=first,
            subsequent_indent=" " * 11,
            break_long_words=False,
            break_on_hyphens=False,
        )
    return lines
