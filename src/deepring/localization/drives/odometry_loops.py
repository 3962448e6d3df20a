"""The trajectory of a recording by odometry, and its loops: one pass over the scans."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.data.left_out import LeftOut
from deepring.data.recording import RecordedScan, Recording, readable_scans
from deepring.errors import BrokenScanError, DataError
from deepring.localization.drives.loop_graph import LoopGraph, Track
from deepring.localization.drives.loops import LoopFinder, LoopSettings
from deepring.localization.drives.odometry import SETTLED, Odometry, OdometrySettings, OdometryStep
from deepring.localization.map import Map
from deepring.progress import Progress

#: Largest share of the scans at which the odometry may be lost, and a number that always may.
MOST_LOST, ALWAYS = 0.02, 3


def find_loops_by_odometry(
    recording: Recording,
    place_map: Map,
    settings: LoopSettings | None = None,
    odometry: OdometrySettings | None = None,
    progress: Progress | None = None,
    left_out: LeftOut | None = None,
) -> tuple[Track, LoopGraph]:
    """Go through a recording once: the pose of each scan, and the loops of the keyframes.

    A scan that cannot be used is left out, and the odometry goes on. Where it is lost, it begins
    anew at the pose to which the last velocity leads: the graph has a break there, which loops may
    mend. Keyframes are as far apart as the settings say, by the odometry. Of their points, those
    that the refinement needs are kept in memory.

    Args:
        recording: the scans, read one at a time.
        place_map: see `LoopFinder`; it stays empty if there is an error.
        settings: of keyframes and loops.
        odometry: of the registration of scans.
        progress: called with scans done and their total.
        left_out: receives the scans that cannot be used.

    Raises:
        ConfigError: a library that is not installed.
        DataError: fewer scans than show whether they overlap (6), too many that cannot be used
            (`deepring.data.left_out`), or at which the odometry is lost, or none of which anything
            stands out of the ground.
    """
    checks.of_type("recording", recording, Recording)
    pass_ = _Pass(
        recording,
        LoopFinder(place_map, settings),
        Odometry(odometry),
        LeftOut() if left_out is None else left_out,
    )
    with place_map.all_or_nothing():
        pass_.run(progress)
    return pass_.track(), pass_.graph()


@dataclass
class _Pass:
    """One pass over a recording, and what it has gathered."""

    recording: Recording
    finder: LoopFinder
    odometry: Odometry
    left_out: LeftOut
    scans: list[int] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    stamps: list[int | None] = field(default_factory=list)
    poses: list[NDArray[np.float64]] = field(default_factory=list)
    keyframes: list[int] = field(default_factory=list)
    """Rows of the lists above."""
    lost: list[int] = field(default_factory=list)
    """Rows before which the motion is not known."""
    breaks: list[int] = field(default_factory=list)
    blank: list[str] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    timed: int = 0

    def run(self, progress: Progress | None) -> None:
        """Register each scan, and look keyframes up."""
        total = len(self.recording)
        self.left_out.what, self.left_out.total = f"session {self.recording.name}", total
        for number, scan in enumerate(readable_scans(self.recording, self.damage)):
            try:
                step = self._register(number, scan)
                if self._is_keyframe():
                    self._look_up(scan, step)
            except BrokenScanError as error:
                reason = str(error)
                self.left_out.add(reason if scan.name in reason else f"{scan.name}: {reason}")
            if progress is not None:
                progress(number + 1, max(number + 1, total))
        self._expect_some()

    def _register(self, number: int, scan: RecordedScan) -> OdometryStep:
        step = self.odometry.register(scan.read(), scan.stamp)
        if step.lost:
            self.lost.append(len(self.scans))
            self._expect_tracked(scan)
        self.scans.append(number)
        self.names.append(scan.name)
        self.stamps.append(scan.stamp)
        self.poses.append(step.pose)
        self.timed += step.deskewed
        return step

    def _is_keyframe(self) -> bool:
        """Whether the last scan is so far from the last keyframe, or the first behind a break."""
        if not self.keyframes or self._behind_break():
            return True
        shift = self.poses[-1][:2, 3] - self.poses[self.keyframes[-1]][:2, 3]
        spacing = self.finder.settings.spacing
        return spacing == 0 or float(np.hypot(*shift)) > spacing

    def _behind_break(self) -> bool:
        return bool(self.lost) and self.keyframes[-1] < self.lost[-1]

    def _look_up(self, scan: RecordedScan, step: OdometryStep) -> None:
        try:
            seen = self.finder.see(scan.name, step.points)
        except BrokenScanError as error:  # the next scan is tried; the odometry has taken this one
            self.blank.append(str(error))
            return
        if self.keyframes and self._behind_break():
            self.breaks.append(len(self.keyframes))
        self.finder.add(scan.name, step.points, seen, step.pose)
        self.keyframes.append(len(self.scans) - 1)

    def _expect_tracked(self, scan: RecordedScan) -> None:
        """Raise DataError where the odometry was lost too often."""
        total = len(self.recording)
        if len(self.lost) > max(ALWAYS, MOST_LOST * total):
            raise DataError(
                f"session {self.recording.name}: the odometry was lost {len(self.lost)} times in "
                f"{total} scans, last at {scan.name}; expected scans that follow each other so "
                "closely that most of each overlaps the last, 10 a second or one a metre: give "
                "all scans of the drive, in order"
            )

    def _expect_some(self) -> None:
        """Raise DataError for too few scans, or none that shows anything."""
        what = f"session {self.recording.name}"
        if len(self.scans) <= SETTLED:
            first = f"; first: {self.left_out.reasons[0]}" if len(self.left_out) else ""
            raise DataError(
                f"{what}: {len(self.scans)} of {len(self.recording)} scans can be used, expected "
                f"at least {SETTLED + 1} for an odometry: whether scans overlap shows from then "
                f"on{first}"
            )
        if not self.keyframes:
            raise DataError(f"{what}: no scan can be a keyframe; first: {self.blank[0]}")

    def track(self) -> Track:
        """The scans that were used, with their poses."""
        return Track(
            self.recording.name,
            np.array(self.scans),
            self.names,
            np.stack(self.poses),
            _stamps(self.stamps),
            by_odometry=True,
            deskewed=self.timed,
            doubts=tuple(self._doubts()),
        )

    def graph(self) -> LoopGraph:
        """Keyframes, as rows of the track, and their loops."""
        stamps = _stamps([self.stamps[row] for row in self.keyframes])
        rows = np.array(self.keyframes)
        poses = np.stack([self.poses[row] for row in self.keyframes])
        return LoopGraph(rows, poses, stamps, self.finder.loops, tuple(self.breaks))

    def _doubts(self) -> list[str]:
        doubts = list(self.damage)
        known = [stamp for stamp in self.stamps if stamp is not None]
        late = sum(b <= a for a, b in pairwise(known))
        if late:
            doubts.append(
                f"{late} of {len(known)} scans have a stamp that is not later than the one before; "
                "expected the time of each scan, in its order: what is compared or joined by these "
                "stamps will be wrong"
            )
        if self.lost:
            where = ", ".join(self.names[row] for row in self.lost[:5])
            doubts.append(
                f"the odometry was lost at {len(self.lost)} of {len(self.scans)} scans, and began "
                f"anew there: {where}{', ...' if len(self.lost) > 5 else ''}; the pose after it is "
                "a guess, unless loops lead across"
            )
        if self.blank:
            doubts.append(
                f"{len(self.blank)} scans could not be keyframes, and the next was tried; first: "
                f"{self.blank[0]}"
            )
        return doubts


def _stamps(stamps: list[int | None]) -> NDArray[np.int64] | None:
    known = [stamp for stamp in stamps if stamp is not None]
    return np.array(known, dtype=np.int64) if len(known) == len(stamps) else None
