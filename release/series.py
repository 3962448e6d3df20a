"""An environment without extras, and copies of it with some: each is installed and tried."""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from release.environment import CommandError, Environment
from release.outcome import PASSED, Outcome
from release.requirements import constrained, lowest, of_users
from release.trials import TRIALS, Trial, smoke

NEWEST, LOWEST = "newest", "lowest"


@dataclass(frozen=True)
class Group:
    """Extras of one environment, and what is tried in it."""

    names: Sequence[str]
    trials: dict[str, Trial]

    @classmethod
    def of(cls, names: Sequence[str]) -> "Group":
        """Extras with what each is for."""
        return cls(names, {name: TRIALS[name] for name in names})

    @property
    def title(self) -> str:
        """The row of the table."""
        several = len(self.trials) > 1
        return f"{len(self.names)} extras together" if several else ", ".join(self.trials)


@dataclass(frozen=True)
class Series:
    """What the environments have in common."""

    python: str
    interpreter: Path
    wheel: Path
    constraints: Path | None
    versions: str
    """NEWEST or LOWEST; what the constraints pin is never lowered."""

    def outcomes(self, folder: Path, groups: Sequence[Group]) -> Iterator[Outcome]:
        """The environment without extras, then one for each group; deleted at the end."""
        plain = Environment(folder / self.python)
        try:
            yield (outcome := self._tried(plain, "without extras", lambda: self._first(plain)))
            if outcome.result == PASSED:
                for group in groups:
                    yield self._copied(Environment(folder / "extras"), plain, group)
        finally:
            plain.delete()

    def _first(self, plain: Environment) -> None:
        plain.make(self.interpreter)
        plain.install(str(self.wheel), *self._bounds([]), constraints=self.constraints)
        smoke(plain)

    def _copied(self, environment: Environment, plain: Environment, group: Group) -> Outcome:
        def trial() -> None:
            environment.copy(plain)
            asked = f"deepring[{','.join(group.names)}] @ {self.wheel.as_uri()}"
            bounds = self._bounds(group.names)
            environment.install(asked, *bounds, constraints=self.constraints)
            for name, one in group.trials.items():
                _named(name, one, environment)

        try:
            return self._tried(environment, group.title, trial)
        finally:
            environment.delete()

    def _bounds(self, names: Sequence[str]) -> list[str]:
        if self.versions == NEWEST:
            return []
        pinned = constrained(self.constraints)
        return [
            one for one in lowest(of_users(names)) if one.partition("==")[0].lower() not in pinned
        ]

    def _tried(self, environment: Environment, what: str, trial: Callable[[], None]) -> Outcome:
        pinned = sorted(constrained(self.constraints)) if self.versions == LOWEST else []
        versions = self.versions + "".join(f" but {name}" for name in pinned)
        start, result, installed = time.monotonic(), PASSED, ""
        try:
            trial()
            installed = environment.versions()
        except CommandError as error:
            print(error, file=sys.stderr)
            result = f"failed: {str(error).partition(chr(10))[0][:120]}"
        return Outcome(self.python, versions, what, result, time.monotonic() - start, installed)


def _named(name: str, trial: Trial, environment: Environment) -> None:
    try:
        trial(environment)
    except CommandError as error:
        raise CommandError(f"{name}: {error}") from error
