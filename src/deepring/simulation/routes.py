"""Routes through the street graph: cover every street, then drive the same streets otherwise."""

from collections import deque
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from deepring.simulation.streets import Street, Streets

Route = list[int]

_TRIALS = 600


def database_route(streets: Streets, rng: np.random.Generator) -> tuple[Route, Route]:
    """Crossings in driving order: through the train part up to the link, then the test part.

    Each part's route takes a street not yet driven wherever there is one.
    """
    train = _cover(streets.train, streets.link[0], rng)
    train += _shortest(streets.train, train[-1], {streets.link[0]})[1:]
    return train, _cover(streets.test, streets.link[1], rng)


def query_route(route: Route, reversed_share: float, rng: np.random.Generator) -> Route:
    """The same streets as ``route`` in another order, a share of them the other way round.

    Between two visits of one crossing a route is a loop: loops that follow each other change
    places, and loops are driven backwards until the share is as near ``reversed_share`` as the
    streets allow. Start, end and the streets driven stay the same.
    """
    varied = list(route)
    for _ in range(_TRIALS):
        varied = _swap_loops(varied, rng)
    best = abs(opposed_share(route, varied) - reversed_share)
    for _ in range(_TRIALS):
        trial = _turn_loop(varied, rng)
        error = abs(opposed_share(route, trial) - reversed_share)
        if error < best and _u_turns(trial) <= _u_turns(route):
            varied, best = trial, error
    return varied


def opposed_share(route: Sequence[int], other: Sequence[int]) -> float:
    """Share of ``other``'s passes along a street in a direction ``route`` never drives it."""
    driven = set(pairwise(route))
    passes = list(pairwise(other))
    return sum(step not in driven for step in passes) / max(len(passes), 1)


def _cover(streets: Iterable[Street], start: int, rng: np.random.Generator) -> Route:
    """A route from ``start`` along every street, new streets first."""
    streets = tuple(streets)
    left = {frozenset(street) for street in streets}
    route = [start]
    while left:
        here = route[-1]
        new = [n for n in _adjacent(streets, here) if frozenset((here, n)) in left]
        if new:
            route.append(new[int(rng.integers(len(new)))])
            left.remove(frozenset(route[-2:]))
        else:
            goals = {crossing for street in left for crossing in street}
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
    """Exchange two loops that follow each other, where a crossing is visited three times."""
    i, j, k = _visits(route, 3, rng)
    swapped = route[:i] + route[j:k] + route[i:j] + route[k:]
    return swapped if _u_turns(swapped) <= _u_turns(route) else route


def _visits(route: Route, count: int, rng: np.random.Generator) -> list[int]:
    """``count`` visits, in order, of a random crossing; the same visit twice if it has fewer."""
    crossing = route[int(rng.integers(len(route)))]
    visits = [i for i, c in enumerate(route) if c == crossing]
    return sorted(int(i) for i in rng.choice(visits, count, replace=len(visits) < count))


def _u_turns(route: Route) -> int:
    return sum(a == c for a, c in zip(route, route[2:], strict=False))
