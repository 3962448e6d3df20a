"""The mutated inputs: each follows from its format, a seed and a number alone."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from fuzz.files import Files, Format, read_back, written
from fuzz.limits import Limits
from fuzz.outcomes import Outcome, outcome_of


@dataclass(frozen=True)
class Name:
    """What tells one input from all others."""

    format: str
    seed: int
    number: int

    def __str__(self) -> str:
        return f"{self.format}:{self.seed}:{self.number}"

    @classmethod
    def parse(cls, text: str) -> "Name":
        """The name that `str` gives."""
        format, seed, number = text.rsplit(":", 2)
        return cls(format, int(seed), int(number))


def names(formats: Sequence[Format], seed: int, inputs: int) -> Iterator[Name]:
    """The names of ``inputs`` inputs or a few more, by the formats' weights."""
    total = sum(format.weight for format in formats)
    for format in formats:
        for number in range(max(1, round(inputs * format.weight / total))):
            yield Name(format.name, seed, number)


def mutated(format: Format, name: Name, good: Files) -> tuple[Files, str]:
    """The files of an input, and what was done to the good ones."""
    rng = Random(str(name))
    files = dict(good)
    return files, rng.choice(format.mutations)(rng, files)


@dataclass
class Bench:
    """One format's good files in a folder, where inputs take their place one after the other."""

    format: Format
    folder: Path
    limits: Limits = field(default_factory=Limits)
    good: Files = field(init=False)
    value: Any = field(init=False)
    """What the good files give."""

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        self.good = self.format.make(self.folder)
        written(self.folder, self.good)
        self.value = self.format.use(self.folder)
        self._put({})

    def run(self, name: Name) -> tuple[Outcome, str]:
        """The outcome of one input, and how it was made."""
        files, done = mutated(self.format, name, self.good)
        changed = {path: files[path] for path in files if files[path] != self.good.get(path)}
        written(self.folder, changed)
        outcome = outcome_of(self.format, self.folder, files, self.value, self.limits)
        self._put(changed)
        return outcome, done

    def _put(self, changed: Files) -> None:
        """Put the good files back."""
        if self.format.clean:
            for path in set(read_back(self.folder)) - set(self.good):
                (self.folder / path).unlink()
            written(self.folder, self.good)
        else:
            written(self.folder, {path: self.good[path] for path in changed})
