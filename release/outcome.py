"""What became of each check, as a table and as an exit status."""

from collections.abc import Sequence
from dataclasses import dataclass

PASSED, NOT_CHECKED = "passed", "not checked"

#: Exit statuses: something failed; nothing failed, but not all could be checked.
FAILED_STATUS, UNKNOWN_STATUS = 1, 3


@dataclass(frozen=True)
class Outcome:
    """One row of the table."""

    python: str
    versions: str
    """Of the packages beside deepring: newest, lowest, or none where nothing is installed."""
    what: str
    """What was installed and tried."""
    result: str
    """`PASSED`, "failed: STEP", or `NOT_CHECKED` with the reason."""
    seconds: float = 0.0
    packages: str = ""
    """The versions that were installed of what decides most."""


def table(outcomes: Sequence[Outcome]) -> str:
    """A Markdown table."""
    head = "| python | versions | what | result | s | of them |\n|---|---|---|---|---:|---|"
    rows = [
        f"| {one.python} | {one.versions} | {one.what} | {one.result} | {one.seconds:.0f} "
        f"| {one.packages} |"
        for one in outcomes
    ]
    return "\n".join([head, *rows])


def status(outcomes: Sequence[Outcome]) -> int:
    """0 if there are outcomes and all passed; what was not checked never counts as passed."""
    results = [one.result for one in outcomes]
    if any(result not in (PASSED,) and not result.startswith(NOT_CHECKED) for result in results):
        return FAILED_STATUS
    return 0 if results and set(results) == {PASSED} else UNKNOWN_STATUS
