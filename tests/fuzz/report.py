"""The outcomes as a table, and the faults by their kinds with the inputs that show them."""

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Sequence

from fuzz.inputs import Name
from fuzz.outcomes import BAD, GOOD, Outcome
from fuzz.processes import Result

#: Inputs named for each kind of fault.
SHOWN = 3


def table(results: Iterable[Result]) -> str:
    """A row per format, a column per kind of outcome."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for name, outcome, _ in results:
        counts[name.format][outcome.kind] += 1
    header = ["format", "inputs", *GOOD, *BAD]
    rows = [[name, str(sum(c.values())), *_cells(c)] for name, c in counts.items()]
    total: Counter[str] = sum(counts.values(), Counter())
    rows.append(["all", str(sum(total.values())), *_cells(total)])
    widths = [max(len(row[k]) for row in [header, *rows]) for k in range(len(header))]
    lines = [_line(row, widths) for row in [header, *rows]]
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(lines)


def faults(results: Iterable[Result], also: Collection[str] = ()) -> str:
    """Each kind of fault with its number, and the inputs that show it; ``also`` other kinds."""
    kinds: dict[tuple[str, str], list[Result]] = defaultdict(list)
    for result in results:
        if result[1].is_bad or result[1].kind in also:
            kinds[result[1].kind, result[1].detail].append(result)
    lines = []
    for (kind, detail), found in sorted(kinds.items(), key=lambda item: -len(item[1])):
        lines.append(f"{len(found):5d}  {kind}: {detail}")
        for name, outcome, done in found[:SHOWN]:
            lines.append(f"         {name}  ({done[:120]!a}) {outcome.said[:200]!a}")
    return "\n".join(lines)


def bad(results: Sequence[Result]) -> int:
    """The number of faults."""
    return sum(outcome.is_bad for _, outcome, _ in results)


def one(name: Name, outcome: Outcome, done: str) -> str:
    """The outcome of a single input."""
    words = f"{name}: {outcome.kind}{': ' if outcome.detail else ''}{outcome.detail}"
    return f"{words}\n  {done!a}\n  {outcome.said!a}"


def _cells(counts: Counter[str]) -> list[str]:
    return [str(counts[kind]) if counts[kind] else "." for kind in (*GOOD, *BAD)]


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    first, *rest = zip(row, widths, strict=True)
    return "  ".join([first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in rest)])
