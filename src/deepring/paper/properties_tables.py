"""The tables of properties as texts: what a method bears, what it tells, and what it costs."""

import math
from collections.abc import Sequence
from dataclasses import fields

from deepring.paper.properties import EXACT, SHIFTS_M, Properties
from deepring.reports.table import NONE, Cell, Table, full_text, short_text

_ABOUT_LOSS = (
    "losses are shares of what separates a scan's score with itself from its score with scans of "
    f"other places: 0 as the scan itself, 1 as another place; exact: at most {EXACT:g}"
)
_ABOUT_SAME = (
    "turned by whole sectors, each of that angle, a scan has the same descriptor, or one that is "
    "aligned when it is compared (loss below 0.5), or neither (-); by any angle where a method has "
    "no sectors"
)


def shown_tables(
    rows: Sequence[Properties], conditions: str, notes: Sequence[str]
) -> dict[str, Table]:
    """What methods bear, tell and cost, by the names of their files.

    ``conditions`` are the words behind the titles, ``notes`` stand below the first table.
    """
    return {
        "properties_borne": _borne(rows, conditions, notes),
        "properties_told": _told(rows, conditions),
        "properties_cost": _cost(rows, conditions),
    }


def number_table(rows: Sequence[Properties]) -> Table:
    """Every number in full; "" where there is none."""
    shifts = [f"loss_{metres:g}_m" for metres in SHIFTS_M]
    headers = []
    for field in fields(Properties):
        of_tuple = {"shifts": shifts, "pose_error": ["pose_error_m", "pose_error_deg"]}
        losses = {name: f"loss_{name}" for name in ("sectors", "any_turn", "half_turn")}
        headers += of_tuple.get(field.name, [losses.get(field.name, field.name)])
    return Table("Properties", headers, [[*map(Cell, _numbers(row))] for row in rows], 1)


def _numbers(row: Properties) -> list[str]:
    texts = []
    for field in fields(Properties):
        value = getattr(row, field.name)
        parts = value if isinstance(value, tuple) else [value]
        if field.name == "pose_error" and value is None:
            parts = [None, None]
        texts += [part if isinstance(part, str) else full_text(part) for part in parts]
    return texts


def _borne(rows: Sequence[Properties], conditions: str, notes: Sequence[str]) -> Table:
    shifts = [f"{metres:g} m" for metres in SHIFTS_M]
    headers = ["Approach", "turned", "sectors", "each", "any turn", "half", *shifts]
    cells = [
        [
            *(row.method, _turned(row), _loss(row.sectors), _degrees(row.sector_deg)),
            *map(_loss, (row.any_turn, row.half_turn, *row.shifts)),
        ]
        for row in rows
    ]
    title = f"What a turn and a shift cost{conditions}"
    return Table(title, headers, _cells(cells), 2, notes=[_ABOUT_LOSS, _ABOUT_SAME, *notes])


def _told(rows: Sequence[Properties], conditions: str) -> Table:
    headers = ["Approach", "turn told to", "modulo", "pose told to"]
    cells = [
        [
            *(row.method, _degrees(row.turn_error_deg)),
            NONE if row.turn_error_deg is None else _degrees(row.turn_period_deg),
            NONE if row.pose_error is None else _pose(*row.pose_error),
        ]
        for row in rows
    ]
    return Table(f"What methods tell{conditions}", headers, _cells(cells), 1)


def _cost(rows: Sequence[Properties], conditions: str) -> Table:
    headers = ["Approach", "numbers", "bytes", "parameters", "ms/scan", "ms/pair"]
    cells = [
        [
            *(row.method, str(row.numbers), str(row.bytes)),
            str(row.parameters) if row.parameters else NONE,
            *map(short_text, (row.scan_ms, row.pair_ms)),
        ]
        for row in rows
    ]
    return Table(f"What methods cost{conditions}", headers, _cells(cells), 1)


def _turned(row: Properties) -> str:
    if row.same:
        return "same"
    borne = row.any_turn if row.sectors is None else row.sectors
    return "aligned" if borne < 0.5 else NONE


def _loss(loss: float | None) -> str:
    if loss is None or math.isnan(loss):
        return NONE
    return "exact" if abs(loss) <= EXACT else f"{loss:.3f}"


def _degrees(value: float | None) -> str:
    return NONE if value is None or math.isnan(value) else f"{short_text(value)}°"


def _pose(metres: float, degrees: float) -> str:
    return NONE if math.isnan(metres) else f"{short_text(metres)} m, {short_text(degrees)}°"


def _cells(rows: Sequence[Sequence[str]]) -> list[list[Cell]]:
    return [[*map(Cell, row)] for row in rows]
