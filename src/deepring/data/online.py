"""Online retrieval: which scans of the same drive are old enough to be a query's places."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.checks import at_least, count
from deepring.data.session import Session
from deepring.data.spacing import path_lengths
from deepring.errors import ConfigError, DataError

Indices = NDArray[np.int64]


@dataclass
class Earlier:
    """How much earlier than the query a place must be; where several are given, all must hold."""

    seconds: float | None = None
    #: Of driven path.
    metres: float | None = None
    #: Places of the database: with 1, the last place before the query is old enough.
    keyframes: int | None = None


def check_earlier(earlier: Earlier, key: str, online: bool) -> None:
    """Raise ConfigError unless something is given where queries are online, and nothing elsewhere.

    ``key`` is that of the values in messages, such as 'data.earlier'.
    """
    given = {name: value for name, value in vars(earlier).items() if value is not None}
    if not online and given:
        name, value = next(iter(given.items()))
        raise ConfigError(f"{key}.{name}: {value}, expected only with split 'online'; leave it out")
    if online and not given:
        raise ConfigError(
            f"{key}: nothing, expected seconds, metres or keyframes by which a place is earlier "
            f"than its query; set {key}.seconds, {key}.metres or {key}.keyframes"
        )
    for name, value in given.items():
        if name == "keyframes":
            count(f"{key}.{name}", value)
        else:
            at_least(f"{key}.{name}", value, 0, name)


def first_too_recent(
    session: Session, database: Indices, query: Indices, earlier: Earlier, key: str
) -> Indices:
    """The first scan (q,) of the session that is too recent to be a place of each query.

    Never later than the query itself, and never falling from query to query.

    Args:
        session: of both.
        database: (d,) numbers of the places' scans, rising.
        query: (q,) numbers of the queries' scans, rising.
        earlier: checked by `check_earlier`.
        key: of ``earlier`` in messages.

    Raises:
        DataError: seconds for a session without time stamps.
    """
    before = query.copy()
    if earlier.seconds is not None:
        if session.stamps is None:
            raise DataError(
                f"{key}.seconds: {earlier.seconds:g}, but session {session.name} has no time "
                f"stamps; expected some; give {key}.metres or {key}.keyframes with "
                f"{key}.seconds=null"
            )
        stamps = np.maximum.accumulate(session.stamps)
        latest = stamps[query] - round(earlier.seconds * 1e9)
        before = np.minimum(before, np.searchsorted(stamps, latest, side="right"))
    if earlier.metres is not None:
        path = path_lengths(session.positions)
        latest = path[query] - earlier.metres
        before = np.minimum(before, np.searchsorted(path, latest, side="right"))
    if earlier.keyframes is not None:
        # The last place before the query is one keyframe earlier, the one before that two.
        recent = np.searchsorted(database, query) - earlier.keyframes + 1
        first = np.append(database, len(session))[np.maximum(recent, 0)]
        before = np.minimum(before, np.where(recent > 0, first, 0))
    return before
