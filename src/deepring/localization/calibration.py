"""When to trust a location: thresholds that reach a stated precision on a drive whose poses are
known."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import wrap_angle, yaw_of
from deepring.data.session import Points
from deepring.errors import DeepringError
from deepring.localization.map import AcceptanceThresholds, Map

Floats = NDArray[np.float64]

#: Least fits that are tried.
FITS = np.round(np.arange(0.05, 0.605, 0.01), 2)


@dataclass(frozen=True)
class Right:
    """How near to the truth a location is right, and how near the map has to be to expect one."""

    metres: float = 2.0
    degrees: float = 5.0
    reach: float = 20.0
    """Metres from a scan to the nearest map place, up to which it should be located."""


class Trials(NamedTuple):
    """n scans located in a map, beside the truth."""

    fit: Floats
    ratio: Floats
    metres: Floats
    """(n,) from the located position to the true one."""
    degrees: Floats
    """(n,) from the located heading to the true one."""
    nearest: Floats
    """(n,) metres from the true position to the nearest map place."""

    def right(self, wanted: Right) -> NDArray[np.bool_]:
        """(n,) which locations are right."""
        return (self.metres < wanted.metres) & (self.degrees < wanted.degrees)

    def trusted(self, trust: AcceptanceThresholds) -> NDArray[np.bool_]:
        """(n,) which are trusted."""
        return (self.fit >= trust.fit) & (self.ratio >= trust.ratio)


class Calibrated(NamedTuple):
    """Thresholds and what they did on the trials they were chosen by."""

    trust: AcceptanceThresholds
    precision: float
    """Share of trusted locations that are right."""
    recall: float
    """Share of the scans within reach of the map that are trusted and right."""
    trusted: int
    scans: int


def try_out(
    held: Map, scans: Iterable[tuple[Points, Floats]], ground_z: float | None = None
) -> Trials:
    """Locate scans (n, 3) with their poses (4, 4) in the map's world; z of their ground where it
    is not the map's."""
    rows = []
    places = held.poses[:, :2, 3].numpy()
    for points, pose in scans:
        found = held.localize(points, ground_z=ground_z)
        rows.append(
            (
                found.fit,
                found.ratio,
                np.hypot(found.x - pose[0, 3], found.y - pose[1, 3]),
                abs(np.degrees(wrap_angle(found.yaw - float(yaw_of(pose))))),
                np.linalg.norm(places - pose[:2, 3], axis=1).min(),
            )
        )
    return Trials(*np.array(rows, dtype=np.float64).reshape(-1, 5).T)


def join(trials: Sequence[Trials]) -> Trials:
    """All of them as one."""
    return Trials(*(np.concatenate(parts) for parts in zip(*trials, strict=True)))


def calibrate(trials: Trials, precision: float, wanted: Right | None = None) -> Calibrated:
    """The thresholds that trust the most right locations at a precision of at least this.

    One more trusted location is counted as wrong, so that a precision of 0.99 needs at least 99
    right ones. Raises DeepringError where no thresholds reach the precision.
    """
    if not 0 < precision < 1:
        raise DeepringError(f"precision: {precision}, expected a share between 0 and 1")
    wanted = wanted or Right()
    right = trials.right(wanted)
    most, chosen = 0, None
    for fit in FITS:
        # Among those that fit, by falling ratio: right and all up to each.
        order = np.flatnonzero(trials.fit >= fit)
        order = order[np.argsort(-trials.ratio[order], kind="stable")]
        good = np.cumsum(right[order])
        enough = good >= precision * (np.arange(1, len(order) + 1) + 1)
        # A ratio that several share cannot be cut between them.
        last = np.append(np.diff(trials.ratio[order]) != 0, True)[: len(order)]
        reached = np.flatnonzero(enough & last)
        if len(reached) and good[reached[-1]] >= most:
            most = int(good[reached[-1]])
            chosen = AcceptanceThresholds(float(fit), float(trials.ratio[order[reached[-1]]]))
    if chosen is None:
        raise DeepringError(
            f"precision: {precision:g} is reached by no thresholds: {int(right.sum())} of "
            f"{len(right)} scans are located within {wanted.metres:g} m and {wanted.degrees:g}°; "
            "take more scans, a denser map, or a lower precision"
        )
    return outcome(trials, chosen, wanted)


def outcome(trials: Trials, trust: AcceptanceThresholds, wanted: Right | None = None) -> Calibrated:
    """What thresholds do on trials."""
    wanted = wanted or Right()
    right, trusted = trials.right(wanted), trials.trusted(trust)
    both, reachable = int((right & trusted).sum()), trials.nearest <= wanted.reach
    return Calibrated(
        trust,
        both / max(1, int(trusted.sum())),
        int((right & trusted & reachable).sum()) / max(1, int(reachable.sum())),
        int(trusted.sum()),
        len(right),
    )
