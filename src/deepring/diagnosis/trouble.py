"""What stands in the way of the commands, or makes them slow."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Trouble:
    """One thing that is wrong or slow.

    >>> print(Trouble("threads", "1 of 2 cores is used", "unset OMP_NUM_THREADS"))
    threads: 1 of 2 cores is used; unset OMP_NUM_THREADS
    """

    subject: str
    """What it is about: packages, threads, processor, memory, GPU, folders, network, timings."""
    found: str
    advice: str
    """What to change."""
    fails: bool = False
    """Whether commands fail by it; otherwise they are slow, or may fail."""

    def __str__(self) -> str:
        return f"{self.subject}: {self.found}; {self.advice}"
