"""The reports of a dataset check as plain text."""

from collections.abc import Sequence

from deepring.data.check import JUMP_M, TIME_GAP_S, SessionReport

MOST_BROKEN = 5  # broken files listed per session


def report_lines(reports: Sequence[SessionReport]) -> list[str]:
    """Lines of a table with one row per session, followed by one line per defect."""
    header = ("session", "scans", "no pose", "broken", "bad poses", "time", "path", "points/scan")
    rows = [header, *(_row(report) for report in reports)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(header))]
    lines = [_aligned(row, widths) for row in rows]
    lines.insert(1, "  ".join("-" * width for width in widths))
    for report in reports:
        lines += _details(report)
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


def _details(report: SessionReport) -> list[str]:
    lines = []
    if report.problem is not None:
        lines.append(f"{report.name}: cannot be opened: {report.problem}")
    elif not report.usable:
        lines.append(f"{report.name}: not usable: none of its {report.scans} scans can be read")
    if report.time_gaps is not None and report.time_gaps.count:
        count, largest = report.time_gaps.count, report.time_gaps.largest
        lines.append(
            f"{report.name}: {count} time gaps > {TIME_GAP_S:g} s, largest {largest:.1f} s"
        )
    if report.jumps.count:
        count, largest = report.jumps.count, report.jumps.largest
        lines.append(f"{report.name}: {count} jumps > {JUMP_M:g} m, largest {largest:.1f} m")
    lines += [f"{report.name}: broken: {reason}" for reason in report.broken[:MOST_BROKEN]]
    if len(report.broken) > MOST_BROKEN:
        lines.append(f"{report.name}: ... and {len(report.broken) - MOST_BROKEN} more broken files")
    return lines
