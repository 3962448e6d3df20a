"""When to trust a location: thresholds that reach a stated precision on a drive whose poses are
known."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.core.rigid import wrap_angle, yaw_of
from deepring.data.session import Points
from deepring.errors import DataError
from deepring.localization.given import given_poses
from deepring.localization.location import AcceptanceThresholds, Location
from deepring.localization.map import Map

Floats = NDArray[np.float64]

#: Thresholds of the fit that are tried.
FITS = np.round(np.arange(0.05, 0.605, 0.01), 2)


@dataclass(frozen=True)
class Tolerance:
    """Errors up to which a location is correct, and the distance up to which one is expected."""

    metres: float = 2.0
    degrees: float = 5.0
    reach: float = 20.0
    """A scan should be located if a map place lies within this distance, metres."""

    def __post_init__(self) -> None:
        for name in ("metres", "degrees", "reach"):
            checks.positive(f"tolerance.{name}", getattr(self, name))


class LocalizationTrials(NamedTuple):
    """Locations of n scans in a map, compared with the truth."""

    fit: Floats
    ratio: Floats
    metres: Floats
    """(n,) from the located position to the true one."""
    degrees: Floats
    """(n,) from the located heading to the true one."""
    nearest: Floats
    """(n,) metres from the true position to the nearest map place."""
    cells: Floats
    """(n,) occupied cells, as in `Location`."""

    def correct(self, tolerance: Tolerance) -> NDArray[np.bool_]:
        """Mask (n,) of the correct locations."""
        return (self.metres < tolerance.metres) & (self.degrees < tolerance.degrees)

    def trusted(self, thresholds: AcceptanceThresholds) -> NDArray[np.bool_]:
        """Mask (n,) of the locations that reach the thresholds."""
        return np.asarray(thresholds.accept(self.fit, self.ratio, self.cells))


class Calibration(NamedTuple):
    """Thresholds, and their precision and recall on the trials."""

    thresholds: AcceptanceThresholds
    precision: float
    """Share of trusted locations that are correct."""
    recall: float
    """Share of the scans within reach of the map that are trusted and correct."""
    trusted: int
    scans: int


def run_trials(
    place_map: Map, scans: Iterable[tuple[Points, Floats]], ground_z: float | None = None
) -> LocalizationTrials:
    """Locate scans in a map, and compare with their poses.

    Args:
        place_map: the map.
        scans: points (n, 3), and the pose (4, 4) of each scan in the map's world.
        ground_z: z of the ground in the scans' frame, metres; None for the map's.

    Raises DataError as `Map.localize` and `trials_of` do.
    """
    located = ((place_map.localize(points, ground_z=ground_z), pose) for points, pose in scans)
    return trials_of(place_map, located)


def trials_of(place_map: Map, located: Iterable[tuple[Location, Floats]]) -> LocalizationTrials:
    """Locations in a map, each beside the pose (4, 4) of its scan in the map's world.

    Raises DataError for poses that are not rigid.
    """
    rows = []
    places = place_map.places.positions
    for location, given in located:
        (pose,) = given_poses([given], 1)
        rows.append(
            (
                location.fit,
                location.ratio,
                np.hypot(location.x - pose[0, 3], location.y - pose[1, 3]),
                abs(np.degrees(wrap_angle(location.yaw - float(yaw_of(pose))))),
                np.linalg.norm(places - pose[:2, 3], axis=1).min(),
                location.cells,
            )
        )
    return LocalizationTrials(*np.array(rows, dtype=np.float64).reshape(-1, 6).T)


def concatenate(trials: Sequence[LocalizationTrials]) -> LocalizationTrials:
    """Several trials as one. Raises DataError without any."""
    if not trials:
        raise DataError("trials: none, expected at least one")
    return LocalizationTrials(*(np.concatenate(parts) for parts in zip(*trials, strict=True)))


def calibrate(
    trials: LocalizationTrials, precision: float, tolerance: Tolerance | None = None
) -> Calibration:
    """The thresholds that trust the most correct locations at the required precision.

    One more trusted location is counted as wrong, so that a precision of 0.99 needs at least 99
    correct ones. Raises ConfigError for a precision that is no share between 0 and 1, and
    DataError where no thresholds reach it.
    """
    checks.fraction("precision", precision)
    tolerance = tolerance or Tolerance()
    correct = trials.correct(tolerance)
    most, thresholds = 0, None
    for fit in FITS:
        # Those that fit, by falling ratio, and how many of the first are correct.
        order = np.flatnonzero(trials.trusted(AcceptanceThresholds(float(fit), -np.inf)))
        order = order[np.argsort(-trials.ratio[order], kind="stable")]
        ratios = trials.ratio[order]
        good = np.cumsum(correct[order])
        enough = good >= precision * (np.arange(1, len(order) + 1) + 1)
        # A ratio that several share cannot be cut between them, and no threshold is infinite.
        last = np.append(ratios[1:] != ratios[:-1], True)[: len(order)]
        cuts = np.flatnonzero(enough & last & np.isfinite(ratios))
        if len(cuts) and good[cuts[-1]] >= most:
            most = int(good[cuts[-1]])
            thresholds = AcceptanceThresholds(float(fit), float(ratios[cuts[-1]]))
    if thresholds is None:
        right = int(correct.sum())
        raise DataError(
            f"precision: {precision:g} is reached by no thresholds: {right} of {len(correct)} "
            f"scans are located within {tolerance.metres:g} m and {tolerance.degrees:g}°, which "
            f"shows at most a precision of {right / (right + 1):.3f}; take more scans, a denser "
            "map, or a lower precision"
        )
    return evaluate_thresholds(trials, thresholds, tolerance)


def evaluate_thresholds(
    trials: LocalizationTrials,
    thresholds: AcceptanceThresholds,
    tolerance: Tolerance | None = None,
) -> Calibration:
    """Precision and recall of thresholds on trials."""
    tolerance = tolerance or Tolerance()
    correct, trusted = trials.correct(tolerance), trials.trusted(thresholds)
    both, reachable = int((correct & trusted).sum()), trials.nearest <= tolerance.reach
    return Calibration(
        thresholds,
        both / max(1, int(trusted.sum())),
        int((correct & trusted & reachable).sum()) / max(1, int(reachable.sum())),
        int(trusted.sum()),
        len(correct),
    )
