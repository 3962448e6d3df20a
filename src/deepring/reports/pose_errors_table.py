"""Errors of relative poses as a table, for the terminal and for documents."""

import math
from collections.abc import Sequence

from deepring.evaluation.pose_errors import PoseErrors
from deepring.localization.calibration import Tolerance
from deepring.reports import table as tables
from deepring.reports.results_table import interval_text
from deepring.reports.table import NONE, Cell, Table, rate_text
from deepring.reports.terminal_table import TerminalTables, terminal


def render_poses(errors: Sequence[PoseErrors]) -> TerminalTables:
    """One table per test region for the terminal."""
    return terminal(_tables(errors))


def markdown_poses(errors: Sequence[PoseErrors]) -> str:
    """`render_poses` as Markdown, which ends in a newline."""
    return tables.markdown(_tables(errors))


def _tables(errors: Sequence[PoseErrors]) -> list[Table]:
    tolerance = Tolerance()
    right = f"within {tolerance.metres:g} m and {tolerance.degrees:g}°"
    headers = ("method", "trained on", "places", right, "median m", "median °")
    groups: dict[str, list[PoseErrors]] = {}
    for each in errors:
        title = f"{each.case.place}: relative poses of the best places within {each.radius_m:g} m"
        groups.setdefault(title, []).append(each)
    return [Table(title, headers, list(map(_row, group)), 2) for title, group in groups.items()]


def _row(errors: PoseErrors) -> list[Cell]:
    number = len(errors.metres)
    share = NONE
    if number:
        share = f"{rate_text(errors.right / number)} {interval_text(errors.right / number, number)}"
    medians = [f"{value:.2f}" if math.isfinite(value) else NONE for value in errors.medians]
    names = errors.case.method, errors.case.trained_on or NONE
    return [Cell(text) for text in (*names, str(number), share, *medians)]
