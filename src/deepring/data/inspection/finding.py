"""A finding about a dataset: what was measured, and what to change."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One doubt about a session, or the reason why it cannot be used.

    >>> print(Finding("poses", "the path is 55 m in the plane and 100 m in space", "set world_up"))
    poses: the path is 55 m in the plane and 100 m in space; set world_up
    """

    subject: str
    """What it is about: scans, ground, poses, stamps."""
    found: str
    """What was measured, with figures and what was expected."""
    advice: str
    """What to change."""
    unusable: bool = False
    """Whether results from such data would be wrong; otherwise they are doubtful."""

    def __str__(self) -> str:
        return f"{self.subject}: {self.found}; {self.advice}"
