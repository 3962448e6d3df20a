"""How benchmarks measure and what a row of their results holds."""

import importlib.metadata
import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PACKAGES = ("torch", "numpy", "numba", "scipy", "scikit-image")


@dataclass(frozen=True)
class Row:
    """One measurement. Times are seconds for each of ``per`` things."""

    stage: str
    what: str
    n: int
    """Places, points or scans that it was measured over."""
    median: float
    low: float
    high: float
    """Quartiles."""
    per: str
    """What a time is for: 'scan', 'pair', 'query', 'episode'."""
    note: str = ""


def timed(
    function: Callable[[], object], runs: int, share: int = 1, warm_up: int = 2
) -> tuple[float, float, float]:
    """Median and quartiles of the seconds of a call, divided by ``share``."""
    for _ in range(warm_up):
        function()
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        function()
        seconds.append((time.perf_counter() - start) / share)
    low, median, high = np.percentile(seconds, [25, 50, 75])
    return float(median), float(low), float(high)


def machine(threads: int, device: str) -> dict[str, object]:
    """Where and with what it was measured."""
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            versions[package] = None
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "threads": threads,
        "device": device,
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        **versions,
    }


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.is_file():
        for line in information.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def bandwidth(device: str = "cpu") -> float:
    """Bytes a second that one thread, or the GPU, reads: the sum of an array beyond all caches."""
    import torch

    numbers = torch.ones(2**27 if device == "cpu" else 2**28, device=device)

    def read() -> None:
        numbers.sum()
        if device != "cpu":
            torch.cuda.synchronize()

    median, _, _ = timed(read, 5)
    return numbers.numel() * 4 / median
