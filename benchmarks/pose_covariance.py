"""Whether the covariance of a registered pose agrees with its errors.

    python benchmarks/pose_covariance.py sim_nclt=FOLDER sim_mulran=FOLDER kitti=FOLDER
    python benchmarks/pose_covariance.py --fit sim_nclt=outputs/datasets/weights_nclt_110 ...
    python benchmarks/pose_covariance.py rellis=FOLDER       # rellis_os1_64.bin, rellis_vlp32c.bin

Printed is the share of errors within the 95 % region of the covariance (χ² with 6 degrees of
freedom, and 3 for x, y and yaw), with its 95 % interval (Wilson), and beside it that of the inverse
of GICP's Hessian, as is, for the pose where GICP ends, before surfaces are brought together.
Medians are of the errors (GICP's own behind them) and of the standard deviations. Registrations
start 0.4 m (along x and y) and 1° off, at random.

- Of two simulated sessions: pairs up to ``--far`` metres apart. Their poses are exact.
- Of KITTI, neighbouring scans against the poses ("poses"): these are themselves off by more than
  the registration. Then three scans registered in a circle, whose poses must multiply to the
  identity ("circles"; the third the next one, or "revisits" of another pass): the error of the
  circle beside the sum of its three covariances knows no pose. The three share scans, so their
  errors partly cancel: it shows a covariance that is too small, hardly one that is too large.
- The Rellis pair: two sensors on one vehicle at one moment, against their calibration.

--fit prints the factors of the standard deviations that would put 95 % of the errors of all
sessions given, and half of them, where the χ² of 6 degrees of freedom has them.
"""

import argparse
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.readers import list_sessions, open_session
from deepring.data.session import Session
from deepring.evaluation.intervals import wilson
from deepring.localization.registration.pose_covariance import in_sensor_frame
from deepring.localization.registration.refinement import (
    RefinementSettings,
    Registration,
    register,
    settled,
)

#: Scans of one session this close in driving order are no revisit.
APART = 60
PLANAR = np.ix_([0, 1, 5], [0, 1, 5])


class Trial(NamedTuple):
    """Errors (6,) and covariances (6, 6) along the sensor's axes, here and of GICP alone."""

    error: np.ndarray
    covariance: np.ndarray
    gicp_error: np.ndarray
    gicp_covariance: np.ndarray
    unobservable: int
    seconds: float


class Step(NamedTuple):
    """One registration, as it is and judged."""

    found: Registration
    covariance: np.ndarray
    """(6, 6) along the sensor's axes."""
    naive: np.ndarray
    unobservable: int
    converged: bool
    seconds: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="+", metavar="FORMAT=FOLDER")
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--far", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fit", action="store_true")
    args = parser.parse_args()
    print(
        "| | pairs | in the 95 % region | x, y, yaw | inverse Hessian | median m (GICP) "
        "| median ° (GICP) | σ m | σ ° | unobservable | ms |"
    )
    print("| --- | ---: | --- | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    every: list[Trial] = []
    for entry in args.data:
        name, _, root = entry.partition("=")
        for what, trials in measured(name, root, args):
            show(what, trials)
            every += trials
    if args.fit:
        distances = np.array([distance(trial.error, trial.covariance) for trial in every])
        factor = math.sqrt(np.quantile(distances, 0.95) / chi2.ppf(0.95, 6))
        median = math.sqrt(np.median(distances) / chi2.ppf(0.5, 6))
        print(f"factor {factor:.2f} for 95 % of the errors, {median:.2f} for half of them")


def measured(name: str, root: str, args: argparse.Namespace) -> Iterator[tuple[str, list[Trial]]]:
    rng = np.random.default_rng(args.seed)
    if name == "rellis":
        yield "Rellis, OS1 and VLP-32C", [sensor_pair(Path(root), rng)]
        return
    format = name.removeprefix("sim_")
    drives = [open_session(format, root, each) for each in list_sessions(format, root)[:2]]
    label = Path(root).name
    if len(drives) > 1:
        yield label, first(args.pairs, exact_pairs(*drives, args.far, rng))
    else:
        yield f"{label}, poses", first(args.pairs, neighbours(drives[0], rng))
        yield f"{label}, circles", first(args.pairs, circles(drives[0], rng, revisits=False))
        yield f"{label}, revisits", first(args.pairs, circles(drives[0], rng, revisits=True))


def first(count: int, trials: Iterator[Trial | None]) -> list[Trial]:
    """That many; registrations that did not converge are counted on standard output."""
    kept: list[Trial] = []
    failed = 0
    for trial in trials:
        if trial is None:
            failed += 1
        else:
            kept.append(trial)
        if len(kept) == count:
            break
    if failed:
        print(f"| ({failed} did not converge) |")
    return kept


def exact_pairs(
    one: Session, other: Session, far: float, rng: np.random.Generator
) -> Iterator[Trial | None]:
    for k in rng.permutation(len(other.files)):
        away = np.linalg.norm(one.positions - other.positions[k], axis=1)
        near = np.flatnonzero(away < far)
        if len(near):
            j = int(rng.choice(near))
            truth = np.linalg.inv(one.poses[j]) @ other.poses[k]
            yield trial_of(other.points(int(k)), one.points(j), truth, rng)


def neighbours(drive: Session, rng: np.random.Generator) -> Iterator[Trial | None]:
    for k in rng.permutation(len(drive.files) - 1):
        truth = np.linalg.inv(drive.poses[k]) @ drive.poses[k + 1]
        if np.linalg.norm(truth[:3, 3]) < 4:
            yield trial_of(drive.points(int(k) + 1), drive.points(int(k)), truth, rng)


def circles(drive: Session, rng: np.random.Generator, revisits: bool) -> Iterator[Trial | None]:
    """Three scans registered in a circle: the error is what remains of the identity."""
    for k in rng.permutation(len(drive.files) - 2):
        away = np.linalg.norm(drive.positions - drive.positions[k], axis=1)
        near = np.flatnonzero(away < 6)
        near = near[np.abs(near - k) > APART] if revisits else np.array([k + 2])
        if not len(near) or away[k + 1] > 4:
            continue
        last = int(rng.choice(near))
        if away[last] > 8:
            continue
        scans = [int(k), int(k) + 1, last]
        points = [drive.points(scan) for scan in scans]
        steps = []
        for a, b in ((0, 1), (1, 2), (2, 0)):
            truth = np.linalg.inv(drive.poses[scans[a]]) @ drive.poses[scans[b]]
            steps.append(step_of(points[b], points[a], disturbed(truth, rng)))
        yield closed(steps) if all(step.converged for step in steps) else None


def closed(steps: list[Step]) -> Trial:
    """The error of three registrations in a circle, with their covariances brought together."""
    values = []
    for by_gicp in (False, True):
        one, two, three = (
            step.found.by_gicp if by_gicp else step.found.transform for step in steps
        )
        carried = [adjoint(two @ three), adjoint(three), np.eye(6)]
        each = [step.naive if by_gicp else step.covariance for step in steps]
        total = sum(c @ one @ c.T for c, one in zip(carried, each, strict=True))
        values += [perturbation(one @ two @ three, np.eye(4)), total]
    lost = max(step.unobservable for step in steps)
    return Trial(*values, lost, sum(step.seconds for step in steps) / 3)


def adjoint(after: np.ndarray) -> np.ndarray:
    """How a perturbation before ``after`` (4, 4) reads behind it, (6, 6)."""
    back = np.linalg.inv(after)
    rotation, shift = back[:3, :3], back[:3, 3]
    x, y, z = shift
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.block([[rotation, cross @ rotation], [np.zeros((3, 3)), rotation]])


def sensor_pair(root: Path, rng: np.random.Generator) -> Trial:
    """The VLP-32C in the OS1's frame; the calibration is that of the data's description."""
    os1, vlp = (
        np.fromfile(root / f"rellis_{name}.bin", "<f4").reshape(-1, 4)[:, :3]
        for name in ("os1_64", "vlp32c")
    )
    truth = pose_from(rotation_from_rpy(0, 0, math.pi), [-0.252, 0.001, -0.092])
    trial = trial_of(vlp, os1, truth, rng)
    if trial is None:
        raise SystemExit("the Rellis pair did not converge")
    return trial


def trial_of(query, place, truth: np.ndarray, rng: np.random.Generator) -> Trial | None:
    step = step_of(query, place, disturbed(truth, rng))
    if not step.converged:
        return None
    errors = (perturbation(pose, truth) for pose in (step.found.transform, step.found.by_gicp))
    error, gicp_error = errors
    return Trial(error, step.covariance, gicp_error, step.naive, step.unobservable, step.seconds)


def step_of(query, place, start: np.ndarray) -> Step:
    settings, started = RefinementSettings(), time.perf_counter()
    found = register(query.astype(np.float64), place.astype(np.float64), start, settings)
    judged = settled(found, start, settings)
    took = time.perf_counter() - started
    # GICP has the rotation first.
    naive = np.roll(np.linalg.inv(found.hessian), 3, axis=(0, 1))
    own = in_sensor_frame(judged.covariance, judged.transform)
    return Step(found, own, naive, len(judged.unobservable), judged.converged, took)


def disturbed(pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    turn = rotation_from_rpy(0, 0, rng.normal(0, math.radians(1)))
    return pose @ pose_from(turn, [*rng.normal(0, 0.4, 2), 0])


def perturbation(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """The perturbation (6,) of ``found`` that gives ``truth``."""
    left = np.linalg.inv(found) @ truth
    return np.r_[left[:3, 3], Rotation.from_matrix(left[:3, :3]).as_rotvec()]


def distance(error: np.ndarray, covariance: np.ndarray) -> float:
    return float(error @ np.linalg.solve(covariance, error))


def show(what: str, trials: list[Trial]) -> None:
    errors = np.array([trial.error for trial in trials])
    widths = np.array([np.sqrt(np.diag(trial.covariance)) for trial in trials])
    six = share([distance(t.error, t.covariance) for t in trials], 6)
    three = share([distance(t.error[[0, 1, 5]], t.covariance[PLANAR]) for t in trials], 3)
    naive = share([distance(t.gicp_error, t.gicp_covariance) for t in trials], 6)
    metres, turns = (np.median(np.linalg.norm(errors[:, part], axis=1)) for part in HALVES)
    before = np.array([trial.gicp_error for trial in trials])
    gicp = [np.median(np.linalg.norm(before[:, part], axis=1)) for part in HALVES]
    wide, turned = (np.median(np.linalg.norm(widths[:, part], axis=1)) for part in HALVES)
    print(
        f"| {what} | {len(trials)} | {six} | {three} | {naive} "
        f"| {metres:.3f} ({gicp[0]:.3f}) | {math.degrees(turns):.3f} ({math.degrees(gicp[1]):.3f}) "
        f"| {wide:.3f} | {math.degrees(turned):.3f} | "
        f"{sum(t.unobservable > 0 for t in trials)} | "
        f"{np.median([t.seconds for t in trials]) * 1e3:.0f} |",
        flush=True,
    )


HALVES = (slice(0, 3), slice(3, 6))


def share(distances: list[float], freedom: int) -> str:
    """Share within the 95 % region, and its Wilson interval."""
    n = len(distances)
    inside = sum(value < chi2.ppf(0.95, freedom) for value in distances)
    low, high = wilson(inside / n, n)
    return f"{inside / n:.3f} ({low:.2f} to {high:.2f})"


if __name__ == "__main__":
    main()
