"""The paper's case study (Sec. VI-A): what a turn and a translation leave in the magnitudes.

A scan and its moved twin go as sinogram (SG), as polar gram (PG) and as range image (RI) through a
circular convolution layer and the row-wise DFT. Were the representation rotation equivariant and
translation invariant, the magnitudes would be equal once the known turn is undone.
"""

import csv
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from deepring.core.correlation import circular_cross_correlation
from deepring.core.equivariance import relative_error
from deepring.core.spectrum import row_dft_magnitude
from deepring.data.session import Points
from deepring.errors import ConfigError, DataError
from deepring.io.files import replacing
from deepring.nn.circular import CircularConv2d
from deepring.nn.representation import make_representation
from deepring.paper.moved_scans import Motion, Place, Position, other_places
from deepring.rasters import BevRaster, PolarRaster, RangeRaster, Raster

Name = Literal["SG", "PG", "RI"]
Kind = Literal["translation", "rotation", "unrelated"]

NAMES: tuple[Name, ...] = ("SG", "PG", "RI")
#: Those that the paper's figure of a pair shows.
DRAWN: tuple[Name, ...] = ("SG", "PG")
ROWS = 120  # of θ, in all representations
KERNELS = 8  # of the layer, 3 x 3 each

TRANSLATIONS_M = tuple(float(metres) for metres in range(21))
#: Every other one lies half-way between two rows of θ.
ROTATIONS_DEG = tuple(2.5 * (360 / ROWS) * k for k in range(25))

_RASTERS: dict[Name, type[Raster]] = {"SG": BevRaster, "PG": PolarRaster, "RI": RangeRaster}


class Extractor:
    """The simplified feature extractor: representation, one circular layer, row-wise DFT.

    The layer's weights are random, drawn from ``seed`` alone: all representations get the same.
    """

    def __init__(self, name: Name, seed: int = 0) -> None:
        self.raster: Raster = _RASTERS[name]()
        angles = ROWS if name == "SG" else None
        self.representation = make_representation(self.raster, angles, angles)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.layer = CircularConv2d(1, KERNELS, bias=False)

    def rasters(self, scans: Sequence[Points], ground_z: float) -> Tensor:
        """Rasters of the scans (b, ...)."""
        return torch.from_numpy(np.stack([self.raster(points, ground_z) for points in scans]))

    @torch.no_grad()
    def magnitude(self, raster: Tensor) -> Tensor:
        """Rasters (b, ...) to magnitudes of the layer's output, (b, KERNELS, θ, ω)."""
        return row_dft_magnitude(self.layer(self.representation(raster)))


def undo_turn(magnitude: Tensor, yaw_deg: float) -> Tensor:
    """Roll the rows of (..., θ, ω) back by a turn, to the nearest: the paper's manual alignment."""
    return magnitude.roll(-round(yaw_deg * ROWS / 360), dims=-2)


@dataclass(frozen=True, eq=False)
class View:
    """A pair as one representation has it. Over the kernels the root of the sum of squares is
    taken, so that norms of the images shown are those of all kernels together."""

    name: Name
    images: NDArray[np.float32]  # (2, θ, τ) or (2, θ, r): the scan's and its twin's
    magnitudes: NDArray[np.float32]  # (2, θ, ω), the twin's rows rolled back
    difference: NDArray[np.float32]  # (θ, ω)
    error: float  # ‖twin - scan‖ / ‖scan‖ of the magnitudes


@dataclass(frozen=True, eq=False)
class TwinPair:
    """A scan and its moved twin."""

    motion: Motion
    bevs: NDArray[np.bool_]  # (2, n, n) indexed [x, y]
    extent: float  # half the BEV's side, and the largest radius of PG; metres
    views: tuple[View, ...]  # as DRAWN


def case_pair(points: Points, motion: Motion, ground_z: float, seed: int = 0) -> TwinPair:
    """Move a scan and follow both to their difference.

    Args:
        points: (n, 3) metres, in the scan's frame.
        motion: of the twin.
        ground_z: z of the ground below the sensor in the scan's frame, metres.
        seed: of the layer's weights.
    """
    bev = BevRaster()
    twins = (points, motion(points))
    views = tuple(_view(name, twins, motion.yaw_deg, ground_z, seed) for name in DRAWN)
    return TwinPair(motion, np.stack([bev(twin, ground_z) for twin in twins]), bev.extent, views)


def _view(name: Name, twins: Sequence[Points], yaw_deg: float, ground_z: float, seed: int) -> View:
    extractor = Extractor(name, seed)
    rasters = extractor.rasters(twins, ground_z)
    scan, twin = extractor.magnitude(rasters)
    twin = undo_turn(twin, yaw_deg)
    return View(
        name=name,
        images=extractor.representation(rasters)[:, 0].numpy(),
        magnitudes=torch.stack([scan, twin]).norm(dim=1).numpy(),
        difference=(twin - scan).norm(dim=0).numpy(),
        error=relative_error(twin, scan),
    )


@dataclass(frozen=True)
class ErrorRow:
    """Relative errors ‖twin - scan‖ / ‖scan‖ of ``n`` pairs at one motion; a row of the CSV file.

    A pair is unrelated where scan and twin are of different places; it is then aligned as well as
    any shift of the rows can, the reference for what is a large error.
    """

    representation: str  # of NAMES, or a method's name
    kind: Kind
    value: float | None  # the motion's size; None for unrelated pairs
    unit: str  # "m", "deg" or ""
    n: int
    mean: float
    median: float
    q25: float
    q75: float


def measure(
    scans: Iterable[tuple[Points, Position | None]],
    ground_z: float,
    pairs: int = 64,
    repeats: int = 1,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> list[ErrorRow]:
    """Errors of the representations against translation, against rotation, and between places.

    Each pair starts from a random heading, so that it meets the grids at another angle, and moves
    in a random direction. The same arguments give the same rows.

    Args:
        scans: at least one, points (n, 3) and where they were taken, None where unknown; no more
            are taken than the pairs need.
        ground_z: z of the ground below the sensor in the scans' frame, metres.
        pairs: how many in all.
        repeats: pairs a scan, where there are fewer scans.
        seed: of headings, directions and the layer's weights.
        progress: called with (done, total) pairs.

    Returns:
        Rows by representation, kind and value; without two scans `UNRELATED_M` apart (a second
        scan, where positions are unknown) none of kind "unrelated".

    Raises:
        DeepringError: no scan, or a count below 1.
    """
    if pairs < 1 or repeats < 1:
        raise ConfigError(f"pairs: {pairs}, repeats: {repeats}; expected at least 1 each")
    rng = np.random.default_rng(seed)
    extractors = {name: Extractor(name, seed) for name in NAMES}
    errors: dict[Name, list[list[float]]] = {name: [] for name in NAMES}
    seen: list[Place] = []
    still: list[dict[Name, Tensor]] = []  # the rasters (1, ...) of each
    for number, (points, position) in enumerate(scans):
        for _ in range(min(repeats, pairs - len(still))):
            heading, direction = rng.uniform(0, 360), rng.uniform(0, 2 * math.pi)
            itself, moves = twin_motions(heading, direction)
            twins = [motion(points) for motion in (itself, *moves)]
            first = {}
            for name, extractor in extractors.items():
                rasters = extractor.rasters(twins, ground_z)
                errors[name].append(_errors(extractor.magnitude(rasters)))
                first[name] = rasters[:1]
            seen.append(Place(number, position))
            still.append(first)
            progress(len(still), pairs)
        if len(still) == pairs:
            break
    if not still:
        raise DataError("scans: none given; expected at least one")
    others = other_places(seen, rng)
    rows: list[ErrorRow] = []
    for name, extractor in extractors.items():
        places = [(still[a][name], still[b][name]) for a, b in others]
        rows += error_rows(name, errors[name], _unrelated(extractor, places))
    return rows


def twin_motions(heading: float, direction: float) -> tuple[Motion, list[Motion]]:
    """The scan itself at this heading, and its twins: all translations, all rotations."""
    along = math.cos(direction), math.sin(direction)
    return Motion(heading), [
        *(Motion(heading, (t * along[0], t * along[1])) for t in TRANSLATIONS_M),
        *(Motion(heading + yaw) for yaw in ROTATIONS_DEG),
    ]


def _errors(magnitudes: Tensor) -> list[float]:
    """Errors of the twins against the scan, which comes first, in the order of `twin_motions`."""
    turns = [0.0] * len(TRANSLATIONS_M) + list(ROTATIONS_DEG)
    scan, twins = magnitudes[0], magnitudes[1:]
    return [
        relative_error(undo_turn(twin, turn), scan) for twin, turn in zip(twins, turns, strict=True)
    ]


def _unrelated(extractor: Extractor, rasters: Sequence[tuple[Tensor, Tensor]]) -> list[float]:
    """Errors between places at the best alignment, where the correlation is largest."""
    errors = []
    for pair in rasters:
        a, b = (extractor.magnitude(raster)[0] for raster in pair)
        flat_a, flat_b = (m.permute(1, 0, 2).flatten(1)[None] for m in (a, b))
        shift = int(circular_cross_correlation(flat_b, flat_a).shift)
        errors.append(relative_error(b.roll(-shift, dims=-2), a))
    return errors


def error_rows(name: str, errors: ArrayLike, unrelated: ArrayLike) -> list[ErrorRow]:
    """Summaries of errors (pairs, motions), ordered as `twin_motions`, and of unrelated ones."""

    def row(kind: Kind, value: float | None, unit: str, sample: ArrayLike) -> ErrorRow:
        sample = np.asarray(sample)
        mean, *quartiles = map(float, (sample.mean(), *np.percentile(sample, (50, 25, 75))))
        return ErrorRow(name, kind, value, unit, len(sample), mean, *quartiles)

    shifts, turns = np.split(np.transpose(errors), [len(TRANSLATIONS_M)])
    rows = [row("translation", v, "m", s) for v, s in zip(TRANSLATIONS_M, shifts, strict=True)]
    rows += [row("rotation", v, "deg", s) for v, s in zip(ROTATIONS_DEG, turns, strict=True)]
    return [*rows, row("unrelated", None, "", unrelated)] if np.size(unrelated) else rows


def write_errors(path: str | Path, rows: Iterable[ErrorRow]) -> None:
    """Write rows as CSV (UTF-8, one header line), in one step, creating folders as needed.

    Errors have six digits; an unrelated pair's value is empty. Raises DeepringError where the
    file cannot be written.
    """
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([field.name for field in fields(ErrorRow)])
        for row in rows:
            writer.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in astuple(row)])
