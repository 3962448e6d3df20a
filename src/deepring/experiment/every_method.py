"""What ``--learned all`` and ``--fixed all`` mean: which entries of ``conf/method`` are taken.

Methods that learn nothing are taken in every variant, each under its own name. A learned method is
taken once, under the name of its network: in its CPU size, and in a variant that needs no labels
where the data have none.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from deepring.errors import ConfigError
from deepring.experiment.entries import GPU, SMALL, Entry

Kind = Literal["learned", "fixed"]

Lacking = Callable[[Sequence[str]], Mapping[str, Sequence[str]]]
"""From columns of points to those that some dataset lacks, each with the names of the datasets."""


@dataclass(frozen=True)
class Choice:
    """The entries that are taken, and what is said of the others."""

    names: Sequence[str]
    left_out: Mapping[str, Sequence[str]]
    """Reason to the names of entries."""

    def __str__(self) -> str:
        taken = f"{len(self.names)} method{'s' if len(self.names) != 1 else ''}"
        return f"{taken}; {left_out_text(self.left_out)}" if self.left_out else taken


def left_out_text(left_out: Mapping[str, Sequence[str]]) -> str:
    """What is left out and why, counted.

    >>> left_out_text({"for a GPU": ["disco_gpu", "egonn_gpu"], "needs labels": ["ssc"]})
    'left out 3: disco_gpu, egonn_gpu (for a GPU); ssc (needs labels)'
    """
    parts = [f"{', '.join(names)} ({reason})" for reason, names in left_out.items()]
    return f"left out {sum(map(len, left_out.values()))}: {'; '.join(parts)}"


def every_method(kind: Kind, entries: Sequence[Entry], lacking: Lacking) -> Choice:
    """The entries that ``all`` takes.

    Args:
        kind: methods that are trained, or that learn nothing.
        entries: those of ``conf/method``.
        lacking: asks the data; called only if an entry needs further columns of the points.

    Raises:
        ConfigError: nothing is left.
    """
    of_kind = [entry for entry in entries if entry.learns == (kind == "learned")]
    names = {entry.name for entry in entries}
    left_out: dict[str, list[str]] = {}
    sized = []
    for entry in of_kind:
        if kind == "learned" and entry.name.endswith(GPU):
            left_out.setdefault("for a GPU", []).append(entry.name)
        elif kind == "learned" and entry.name + SMALL in names:
            left_out.setdefault("published size, the CPU size is taken", []).append(entry.name)
        else:
            sized.append(entry)
    served = _served(sized, lacking, left_out)
    taken = _once(served, left_out) if kind == "learned" else served
    if not taken:
        raise ConfigError(f"{kind}: all, expected at least one method; {Choice([], left_out)}")
    return Choice([entry.name for entry in taken], left_out)


def _served(
    entries: Sequence[Entry], lacking: Lacking, left_out: dict[str, list[str]]
) -> list[Entry]:
    """The entries whose columns all datasets have."""
    columns = sorted({column for entry in entries for column in entry.columns})
    missing = lacking(columns) if columns else {}
    served = []
    for entry in entries:
        lost = [column for column in entry.columns if column in missing]
        if lost:
            reason = f"needs {lost[0]}s, missing in {' and '.join(missing[lost[0]])}"
            left_out.setdefault(reason, []).append(entry.name)
        else:
            served.append(entry)
    return served


def _once(entries: Sequence[Entry], left_out: dict[str, list[str]]) -> list[Entry]:
    """One entry of each class: its CPU size, or else the first variant."""
    first: dict[str, Entry] = {}
    for entry in sorted(entries, key=lambda each: not each.name.endswith(SMALL)):
        if entry is not first.setdefault(entry.target, entry):
            other = f"in tables it has the name of {first[entry.target].name}"
            left_out.setdefault(other, []).append(entry.name)
    return sorted(first.values(), key=lambda each: each.name)
