"""Rows of the comparison with peers, as Markdown and CSV."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from deepring.evaluation.intervals import wilson
from deepring.io.files import replacing


@dataclass(frozen=True)
class Share:
    """How many of how many, with Wilson's interval of 95 %."""

    good: int
    of: int

    @property
    def interval(self) -> tuple[float, float]:
        return wilson(self.good / self.of if self.of else 0.0, self.of)

    def __str__(self) -> str:
        if not self.of:
            return "none"
        low, high = self.interval
        return f"{self.good / self.of:.3f} ({low:.2f} to {high:.2f})"


def markdown(rows: Sequence) -> str:
    """Rows of one dataclass, whose fields are the columns."""
    if not rows:
        return "nothing to measure"
    names = [field.name for field in fields(rows[0])]
    lines = [
        f"| {' | '.join(name.replace('_', ' ') for name in names)} |",
        f"|{' --- |' * len(names)}",
    ]
    lines += [f"| {' | '.join(_text(getattr(row, name)) for name in names)} |" for row in rows]
    return "\n".join(lines)


def write_csv(path: Path, rows: Sequence) -> None:
    """As `markdown`; a share takes four columns: its value, its interval, and how many of it."""
    if not rows:
        return
    with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        flat = [_flat(row) for row in rows]
        writer.writerow(flat[0])
        writer.writerows(line.values() for line in flat)


def _flat(row) -> dict[str, object]:
    cells: dict[str, object] = {}
    for field in fields(row):
        value = getattr(row, field.name)
        if isinstance(value, Share):
            low, high = value.interval
            cells[field.name] = value.good / value.of if value.of else ""
            cells |= {f"{field.name}_low": low, f"{field.name}_high": high}
            cells[f"{field.name}_of"] = value.of
        else:
            cells[field.name] = "" if value is None else value
    return cells


def _text(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.1f}" if isinstance(value, float) else str(value)
