"""Routes through the street graph: over every street, and over the same in another order."""

from collections import deque
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from deepring.simulation.streets import Street, Streets

Route = list[int]

_TRIALS = 600


def database_route(streets: Streets, rng: np.random.Generator) -> tuple[Route, Route]:
    """Crossings in driving order: the train part up to the link, and the test part.

    Routes prefer new streets wherever possible.
    """
    train = _cover(streets.train, streets.link[0], rng)
    train += _shortest(streets.train, train[-1], {streets.link[0]})[1:]
    return train, _cover(streets.test, streets.link[1], rng)


def query_route(route: Route, reversed_share: float, rng: np.random.Generator) -> Route:
    """The same streets as ``route`` in another order, a share of them in reverse.

    A route between two visits of one crossing is a loop: consecutive loops are exchanged, and
    loops are reversed until the share is as close to ``reversed_share`` as the streets allow.
    Start, end and the set of streets stay the same.
    """
    variant = list(route)
    for _ in range(_TRIALS):
        variant = _swap_loops(variant, rng)
    best = abs(opposed_share(route, variant) - reversed_share)
    for _ in range(_TRIALS):
        trial = _turn_loop(variant, rng)
        error = abs(opposed_share(route, trial) - reversed_share)
        if error < best and _u_turns(trial) <= _u_turns(route):
            variant, best = trial, error
    return variant


def opposed_share(first: Sequence[int], second: Sequence[int]) -> float:
    """Share of the passes of ``second`` in a direction that ``first`` never has on that street."""
    directions = set(pairwise(first))
    passes = list(pairwise(second))
    return sum(step not in directions for step in passes) / max(len(passes), 1)


def _cover(streets: Iterable[Street], start: int, rng: np.random.Generator) -> Route:
    """A route from ``start`` along every street, new streets first."""
    streets = tuple(streets)
    remaining = {frozenset(street) for street in streets}
    route = [start]
    while remaining:
        here = route[-1]
        new = [n for n in _adjacent(streets, here) if frozenset((here, n)) in remaining]
        if new:
            route.append(new[int(rng.integers(len(new)))])
            remaining.remove(frozenset(route[-2:]))
        else:
            goals = {crossing for street in remaining for crossing in street}
            route += _shortest(streets, here, goals)[1:]
    return route


def _adjacent(streets: Iterable[Street], crossing: int) -> list[int]:
    return sorted(a + b - crossing for a, b in streets if crossing in (a, b))


def _shortest(streets: Iterable[Street], start: int, goals: set[int]) -> Route:
    """Fewest streets from ``start`` to any of ``goals``, both ends included."""
    came_from = {start: start}
    waiting = deque([start])
    while waiting:
        here = waiting.popleft()
        if here in goals:
            route = [here]
            while route[-1] != start:
                route.append(came_from[route[-1]])
            return route[::-1]
        for n in _adjacent(streets, here):
            if n not in came_from:
                came_from[n] = here
                waiting.append(n)
    raise ValueError(f"no route from crossing {start} to any of {sorted(goals)}")


def _turn_loop(route: Route, rng: np.random.Generator) -> Route:
    """Drive one random loop backwards."""
    i, j = _visits(route, 2, rng)
    return route[:i] + route[i : j + 1][::-1] + route[j + 1 :]


def _swap_loops(route: Route, rng: np.random.Generator) -> Route:
    """Exchange two consecutive loops at a crossing with three visits."""
    i, j, k = _visits(route, 3, rng)
    variant = route[:i] + route[j:k] + route[i:j] + route[k:]
    return variant if _u_turns(variant) <= _u_turns(route) else route


def _visits(route: Route, count: int, rng: np.random.Generator) -> list[int]:
    """``count`` visits of a random crossing in order, with repetitions if it has fewer."""
    crossing = route[int(rng.integers(len(route)))]
    visits = [i for i, c in enumerate(route) if c == crossing]
    return sorted(int(i) for i in rng.choice(visits, count, replace=len(visits) < count))


def _u_turns(route: Route) -> int:
    return sum(a == c for a, c in zip(route, route[2:], strict=False))
