"""The base class of rasters: how a scan becomes the array that a method takes.

A raster is a frozen dataclass of plain values. They determine the array completely, so that they
are the cache's key and part of a checkpoint. A kind of raster is one file: every subclass of
`Raster` registers its ``kind`` for `make_raster`, the cache and training.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import asdict
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError, DataError
from deepring.io.typed import typed
from deepring.rasters.blank import blank_reason
from deepring.rasters.preprocessing import FARTHEST, Preprocessing, contiguous_points

#: Values of one array: 4096 x 4096 cells.
MOST_VALUES = 2**24

#: Every kind of raster by its name; subclasses of `Raster` register themselves.
RASTERS: dict[str, type["Raster"]] = {}


class Raster(ABC):
    """Turns the points of a scan into an array of fixed shape and type.

    A subclass is a frozen dataclass that names its kind,
    ``@dataclass(frozen=True) class Density(Raster, kind="density")``, and has a field
    ``preprocessing``. Sets of points and of voxels count as rasters too, as arrays of fixed shape.
    """

    kind: ClassVar[str]
    """Name in configs, in checkpoints and in the cache."""
    axes: ClassVar[tuple[str, ...]]
    """Meaning of each axis: 'x', 'y', 'theta', 'r', ... Networks choose their input layer by it."""
    dtype: ClassVar[np.dtype[Any]]
    """Type of the array's values; bool arrays are stored as bits."""
    columns: ClassVar[tuple[str, ...]] = ()
    """Columns of the points that the raster takes behind x, y and z, such as 'label'."""

    preprocessing: Preprocessing

    def __init_subclass__(cls, *, kind: str) -> None:
        previous = RASTERS.get(kind)
        if previous is not None and previous.__qualname__ != cls.__qualname__:
            raise ConfigError(
                f"kind: {kind!r} of {cls.__qualname__}, expected a new name; "
                f"{previous.__qualname__} has this one"
            )
        cls.kind = kind
        RASTERS[kind] = cls

    @property
    @abstractmethod
    def shape(self) -> tuple[int, ...]:
        """Length of each of the ``axes``."""

    @abstractmethod
    def rasterize(self, points: NDArray[np.float32]) -> NDArray[Any]:
        """Array of preprocessed points (n, 3 + columns), z above the ground."""

    def __call__(self, points: Any, ground_z: float) -> NDArray[Any]:
        """Array of a whole scan.

        Args:
            points: (n, >=3), metres, in the scan's frame: anything like an array of real numbers.
                Points that are not finite in float32 do not count. Behind x, y and z come the
                raster's `columns`, if it has any.
            ground_z: z of the ground under the sensor in that frame, metres.

        Raises:
            ConfigError: a ``ground_z`` that is no finite number.
            DataError: points of another shape or type.
        """
        if not self.columns:
            return self.rasterize(self.preprocessing(points, ground_z))
        names = ("x", "y", "z", *self.columns)
        rows = contiguous_points(points)
        if rows.shape[1] < len(names):
            raise DataError(
                f"points: shape {rows.shape}, expected (n, {len(names)}): {', '.join(names)}"
            )
        kept = rows[self.preprocessing.rows(rows, ground_z), : len(names)]
        kept[:, 2] -= np.float32(ground_z)
        return self.rasterize(kept)

    def why_blank(self, points: NDArray[np.floating], ground_z: float) -> str:
        """Why an array of these points (n, >=3) shows nothing of them."""
        reason = blank_reason(points, ground_z, self.preprocessing)
        return f"nothing stands out of the ground: {reason}"

    def is_blank(self, image: NDArray[Any]) -> bool:
        """Whether an array of this raster shows nothing of its scan."""
        return not image.any()

    @property
    def sectors(self) -> int:
        """Number of steps per full turn by which the array can be turned exactly.

        Raises:
            ConfigError: the array cannot be turned.
        """
        raise ConfigError(
            f"raster: a {type(self).__name__} cannot be turned, its axes are "
            f"{', '.join(self.axes)}; expected a raster with an axis of azimuth, points or "
            "voxels; or leave the scans unturned"
        )

    def turned(self, images: Tensor, sectors: Tensor) -> Tensor:
        """The arrays of the same scans turned counter-clockwise by whole sectors.

        Args:
            images: (n, *shape), with azimuth on axis -2.
            sectors: (n,) int64, numbers of `sectors`.
        """
        steps = self.sectors
        rows = (torch.arange(steps)[None] - sectors[:, None]) % steps  # rolled by +sectors
        shape = [len(images), *[1] * (images.dim() - 3), steps, 1]
        return images.gather(-2, rows.view(shape).expand_as(images))

    def check_disc(self, *counts: str) -> None:
        """Raise ConfigError unless the counts are, and ``radius`` is a length within the crop."""
        self.check_counts(*counts)
        self.check_lengths("radius")
        self.check_reach(self.radius)  # type: ignore[attr-defined]

    def check_counts(self, *names: str) -> None:
        """Raise ConfigError unless these fields are whole numbers above 0."""
        for name in names:
            checks.count(f"raster.{name}", getattr(self, name))

    def check_lengths(self, *names: str) -> None:
        """Raise ConfigError unless these fields are metres above 0."""
        for name in names:
            length = checks.positive(f"raster.{name}", getattr(self, name), "metres")
            checks.between(f"raster.{name}", length, 0, FARTHEST, "metres")

    def check_reach(self, reach: float) -> None:
        """Raise ConfigError if the preprocessing removes points within ``reach`` metres."""
        extent = self.preprocessing.extent
        if extent < reach:
            raise ConfigError(
                f"preprocessing.extent: {extent:g} m, but the {type(self).__name__} reaches to "
                f"{reach:g} m; expected at least that"
            )


def raster_settings(raster: Raster) -> dict[str, Any]:
    """Plain values from which `make_raster` makes the raster: ``{"kind": ..., **fields}``.

    >>> from deepring.rasters import PolarRaster
    >>> settings = raster_settings(PolarRaster(sectors=60))
    >>> settings["kind"], settings["sectors"]
    ('polar', 60)
    """
    return {"kind": raster.kind, **asdict(raster)}  # type: ignore[call-overload]


def make_raster(settings: dict[str, Any]) -> Raster:
    """The raster with the settings of `raster_settings`.

    Raises ConfigError for unknown names, values of another type, and more than `MOST_VALUES`.

    >>> make_raster({"kind": "polar", "sectors": 60}).shape
    (60, 120)
    """
    checks.of_type("raster", settings, dict)
    values = dict(settings)
    cls = RASTERS[checks.one_of("raster.kind", values.pop("kind", None), RASTERS)]
    if values.get("preprocessing") is None:
        values.pop("preprocessing", None)
    raster: Raster = typed(cls, values, "raster", whole=False)
    if math.prod(raster.shape) > MOST_VALUES:
        raise ConfigError(
            f"raster: {' x '.join(map(str, raster.shape))} values, expected at most {MOST_VALUES}"
        )
    return raster
