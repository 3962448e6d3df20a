"""What every raster is: the array that a method sees of a scan, and how it comes about.

A raster is a frozen dataclass of plain values. It names everything that made an array, so that it
is the cache's key and travels in a checkpoint. A kind of raster is one file: a subclass of
`Raster` with its own ``kind`` is known to `make_raster`, to the cache and to the training.
"""

from abc import ABC, abstractmethod
from dataclasses import asdict, fields
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError
from deepring.rasters.preprocessing import Preprocessing

#: Every kind of raster by its name; subclasses of `Raster` enter themselves.
RASTERS: dict[str, type["Raster"]] = {}


class Raster(ABC):
    """Points of a scan to an array of fixed shape and type.

    A subclass is a frozen dataclass that names its kind,
    ``@dataclass(frozen=True) class Density(Raster, kind="density")``, and has a field
    ``preprocessing``. Sets of points and of voxels are rasters, too: arrays of a fixed shape.
    """

    kind: ClassVar[str]
    """Name in configs, in checkpoints and in the cache."""
    axes: ClassVar[tuple[str, ...]]
    """What each axis is: 'x', 'y', 'theta', 'r', ... Networks choose their input by it."""
    dtype: ClassVar[np.dtype[Any]]
    """Type of the array's values; bool arrays are stored as bits."""

    preprocessing: Preprocessing

    def __init_subclass__(cls, *, kind: str) -> None:
        known = RASTERS.get(kind)
        if known is not None and known.__qualname__ != cls.__qualname__:
            raise ConfigError(
                f"kind: {kind!r} of {cls.__qualname__}, expected a name of its own; "
                f"{known.__qualname__} has this one"
            )
        cls.kind = kind
        RASTERS[kind] = cls

    @property
    @abstractmethod
    def shape(self) -> tuple[int, ...]:
        """Length of each of the ``axes``."""

    @abstractmethod
    def rasterize(self, points: NDArray[np.float32]) -> NDArray[Any]:
        """Array of the points (n, 3) that the preprocessing leaves, z above the ground."""

    def __call__(self, points: NDArray[np.float32], ground_z: float) -> NDArray[Any]:
        """Array of a whole scan.

        Args:
            points: (n, >=3) float32, metres, in the scan's frame.
            ground_z: z of the ground under the sensor in that frame, metres.
        """
        return self.rasterize(self.preprocessing(points, ground_z))

    @property
    def sectors(self) -> int:
        """Steps of a full turn by which the array can be turned exactly.

        Raises:
            ConfigError: it cannot be turned.
        """
        raise ConfigError(
            f"raster: a {type(self).__name__} cannot be turned, its axes are "
            f"{', '.join(self.axes)}; expected a raster with an axis of azimuth, points or "
            "voxels; or leave the scans unturned"
        )

    def turned(self, images: Tensor, sectors: Tensor) -> Tensor:
        """Arrays as they would be of scans turned counter-clockwise by whole sectors.

        Args:
            images: (n, *shape), with azimuth on axis -2.
            sectors: (n,) int64, of `sectors`.
        """
        steps = self.sectors
        rows = (torch.arange(steps)[None] - sectors[:, None]) % steps  # rolled by +sectors
        shape = [len(images), *[1] * (images.dim() - 3), steps, 1]
        return images.gather(-2, rows.view(shape).expand_as(images))

    def check_counts(self, *names: str) -> None:
        """Raise ConfigError unless these fields are whole numbers above 0."""
        for name in names:
            checks.count(f"raster.{name}", getattr(self, name))

    def check_lengths(self, *names: str) -> None:
        """Raise ConfigError unless these fields are metres above 0."""
        for name in names:
            checks.positive(f"raster.{name}", getattr(self, name), "metres")

    def check_reach(self, reach: float) -> None:
        """Raise ConfigError where the preprocessing cuts off what lies within ``reach`` metres."""
        extent = self.preprocessing.extent
        if extent < reach:
            raise ConfigError(
                f"preprocessing.extent: {extent:g} m, but the {type(self).__name__} reaches to "
                f"{reach:g} m; expected at least that"
            )


def raster_settings(raster: Raster) -> dict[str, Any]:
    """Plain values that make the raster again: ``{"kind": ..., **fields}``.

    >>> from deepring.rasters import PolarRaster
    >>> settings = raster_settings(PolarRaster(sectors=60))
    >>> settings["kind"], settings["sectors"]
    ('polar', 60)
    """
    return {"kind": raster.kind, **asdict(raster)}  # type: ignore[call-overload]


def make_raster(settings: dict[str, Any]) -> Raster:
    """The raster that `raster_settings` described. Raises ConfigError on unknown values.

    >>> make_raster({"kind": "polar", "sectors": 60}).shape
    (60, 120)
    """
    values = dict(settings)
    cls = RASTERS[checks.one_of("raster.kind", values.pop("kind", None), RASTERS)]
    _check_names(f"raster {cls.kind!r}", values, cls)
    if values.get("preprocessing") is None:
        values.pop("preprocessing", None)
    else:
        _check_names("preprocessing", values["preprocessing"], Preprocessing)
        values["preprocessing"] = Preprocessing(**values["preprocessing"])
    return cls(**values)


def _check_names(what: str, values: dict[str, Any], cls: Any) -> None:
    known = [field.name for field in fields(cls)]
    unknown = [name for name in values if name not in known]
    if unknown:
        raise ConfigError(f"{what}: {', '.join(unknown)}, expected only {', '.join(known)}")
