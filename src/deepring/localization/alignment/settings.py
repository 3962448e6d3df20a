"""Sizes of the images and transforms by which scans are aligned."""

import math
from dataclasses import dataclass, replace

from scipy.fft import next_fast_len

from deepring import checks
from deepring.errors import ConfigError

#: Cells along a side of an image or of its transform.
_LARGEST = 2048


@dataclass(frozen=True)
class AlignmentSettings:
    """Settings for images of ``cells`` x ``cells`` over [-extent, extent] metres."""

    cells: int = 120
    extent: float = 70.0
    padded: int = 160
    """Side of the transform: shifts up to ``padded - cells`` cells do not wrap."""
    blur: float = 0.6
    """Deviation of a Gaussian, metres."""
    reach: float = 40.0
    """Largest shift along x and y, metres."""
    step: float = math.radians(3.0)
    """Each turn is also tried smaller and larger by this, radians."""

    def __post_init__(self) -> None:
        checks.count("alignment.cells", self.cells, most=_LARGEST)
        if checks.count("alignment.padded", self.padded, self.cells, _LARGEST) % 2:
            raise ConfigError(f"alignment.padded: {self.padded}, expected an even number")
        for name in ("extent", "blur", "reach"):
            value = checks.positive(f"alignment.{name}", getattr(self, name), "metres")
            checks.between(f"alignment.{name}", value, 0, 10_000, "metres")
        checks.between("alignment.step", self.step, math.radians(0.05), math.pi, "radians")

    @property
    def cell(self) -> float:
        """Side of a cell, metres."""
        return 2 * self.extent / self.cells

    @property
    def coarse(self) -> "AlignmentSettings":
        """The same at half the resolution."""
        cells = -(-self.cells // 2)
        padded = next_fast_len(cells + 1, real=True)
        padded += padded % 2
        return replace(self, cells=cells, extent=cells * self.cell, padded=padded)

    @property
    def shifts(self) -> int:
        """Largest shift in cells."""
        return min(self.padded // 2 - 1, math.ceil(self.reach / self.cell))
