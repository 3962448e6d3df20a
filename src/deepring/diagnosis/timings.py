"""A short measurement of the steps of every command, beside the times that the docs state."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.diagnosis.trouble import Trouble
from deepring.progress import Progress

#: How many times as long as stated is slow.
SLOW = 3.0

#: Milliseconds of a step on a 2-core x86-64 machine, one thread: docs/troubleshooting.md.
STATED = {
    "import torch": 1500.0,
    "scan to sinogram": 0.2,
    "describe a scan": 20.0,
    "search 1000 places": 0.8,
}

#: Seconds that loops take to be loaded at most; longer means that they were compiled.
_LOADED = 4.0


@dataclass(frozen=True)
class Timing:
    """The time of one step, milliseconds."""

    step: str
    milliseconds: float
    stated: float
    """What the docs state."""
    first: float | None
    """Processor time of the first run, with loading or compiling its loops, milliseconds; None for
    a step without loops."""

    def troubles(self) -> Iterator[Trouble]:
        """A step that is slow."""
        if self.milliseconds > SLOW * self.stated:
            advice = (
                "the packages may lie on a slow or remote disk, or other programs take the time"
                if self.step == "import torch"
                else "see the threads, the processor and its load"
            )
            yield Trouble(
                "timings",
                f"{self.step}: {time_text(self.milliseconds)}, "
                f"{self.milliseconds / self.stated:.0f} times the {time_text(self.stated)} of the "
                "docs",
                advice,
            )
        if self.first is not None and self.first > 1e3 * _LOADED:
            yield Trouble(
                "timings",
                f"{self.step}: {self.first / 1e3:.1f} s the first time, as loops were compiled",
                "the next start has them, if the folder of compiled loops can be written",
            )


def time_text(milliseconds: float) -> str:
    """A time in its unit.

    >>> time_text(0.184), time_text(16.71), time_text(9740)
    ('0.18 ms', '17 ms', '9.7 s')
    """
    if milliseconds >= 1000:
        return f"{milliseconds / 1000:.1f} s"
    return f"{milliseconds:.0f} ms" if milliseconds >= 10 else f"{milliseconds:.2g} ms"


def measure(progress: Progress) -> list[Timing]:
    """Import torch and measure each step: the least of several runs, some two seconds in all.

    Where loops are not compiled yet, that is done first, and takes up to half a minute. Raises
    whatever the steps raise.
    """
    start = time.perf_counter()
    import torch

    imported = 1e3 * (time.perf_counter() - start)
    timings = [Timing("import torch", imported, STATED["import torch"], None)]
    progress(1, len(STATED))
    from deepring.core.radon import radon
    from deepring.methods.network_file import shipped_network
    from deepring.rasters import BevRaster
    from deepring.search.correlation_index import CorrelationIndex
    from deepring.search.search_settings import SearchSettings

    points, raster = street(), BevRaster()
    timings.append(
        _timed("scan to sinogram", lambda: radon(torch.from_numpy(raster(points, 0.0))[None]))
    )
    progress(2, len(STATED))
    network = shipped_network().method
    image = torch.from_numpy(network.raster(points, 0.0))[None]
    timings.append(_timed("describe a scan", lambda: network.describe(image)))
    progress(3, len(STATED))
    one = network.describe(image)
    noise = torch.randn(1000, *one.shape[1:], generator=torch.Generator().manual_seed(0))
    index = CorrelationIndex(SearchSettings("int8", code=None))
    index.add(one * (1 + 0.3 * noise))
    timings.append(_timed("search 1000 places", lambda: index.search(one)))
    progress(4, len(STATED))
    return timings


def street(points: int = 70_000) -> NDArray[np.float32]:
    """A scan (n, 3) to measure with: the ground at z = 0 and two rows of facades."""
    rng = np.random.default_rng(0)
    half = points // 2
    ground = np.column_stack([rng.normal(0, 20, (half, 2)), rng.normal(0, 0.03, half)])
    along, up = rng.uniform(-60, 60, points - half), rng.uniform(0, 12, points - half)
    facades = np.column_stack([along, rng.choice([-12.0, 14.0], len(along)), up])
    return np.concatenate([ground, facades]).astype(np.float32)


def _timed(step: str, function: Callable[[], object], seconds: float = 0.3) -> Timing:
    start = time.process_time()
    function()
    first = time.process_time() - start
    least, until = math.inf, time.perf_counter() + seconds
    while not math.isfinite(least) or time.perf_counter() < until:
        start = time.perf_counter()
        function()
        least = min(least, time.perf_counter() - start)
    return Timing(step, 1e3 * least, STATED[step], 1e3 * first)
