"""The machine: its processor, memory and GPU, and what limits the threads that compute."""

import os
import platform
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from deepring.diagnosis.trouble import Trouble

#: Variables that limit the threads of torch, of NumPy's BLAS and of numba.
_THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "SLURM_CPUS_PER_TASK",
)

#: Memory below which the network and a map of some thousand places are short of it, bytes.
_LEAST_MEMORY = 2 << 30


@dataclass(frozen=True)
class Processor:
    """The cores, and how many of them this process may use."""

    name: str
    vectors: str
    """The widest vector instructions: AVX-512, AVX2, NEON; empty where the system does not say."""
    cores: int
    allowed: int
    """Cores that the process may run on."""
    quota: float | None
    """Cores that a container grants, if it limits them."""
    load: float | None
    """Processes that ran or waited to run, on average over the last minute."""

    @property
    def usable(self) -> int:
        """Cores that can work for this process at once."""
        return self.allowed if self.quota is None else max(1, min(self.allowed, int(self.quota)))

    def troubles(self) -> Iterator[Trouble]:
        """What keeps the process from the machine's cores."""
        if self.allowed < self.cores:
            yield Trouble(
                "processor",
                f"{self.allowed} of {self.cores} cores are allowed to this process",
                "ask the scheduler for more, or leave taskset out",
            )
        if self.quota is not None and self.quota < self.allowed:
            yield Trouble(
                "processor",
                f"the container grants {self.quota:g} of {self.allowed} cores",
                "start it with more, as docker run --cpus does",
            )
        if self.load is not None and self.load > 1.2 * self.cores:
            yield Trouble(
                "processor",
                f"{self.load:.1f} processes share {self.cores} cores",
                "wait for the other programs, or stop them; measured times are too long meanwhile",
            )
        if self.vectors in ("AVX", "SSE"):
            yield Trouble(
                "processor",
                f"it has {self.vectors} alone, while loops are fastest with AVX2 or AVX-512",
                "expect times two to four times as long",
            )


@dataclass(frozen=True)
class Threads:
    """The threads that compute, and what limits them."""

    torch: int | None
    numba: int | None
    limits: Mapping[str, str]
    """Variables of the environment that limit them."""

    def troubles(self, usable: int) -> Iterator[Trouble]:
        """Too few threads, or too many."""
        if self.torch is None:
            return
        named = ", ".join(f"{name}={value}" for name, value in self.limits.items())
        if self.torch < usable:
            yield Trouble(
                "threads",
                f"torch uses {self.torch} of {usable} cores" + (f" ({named})" if named else ""),
                f"set OMP_NUM_THREADS={usable} for a single run; several at once are best with 1",
            )
        if self.torch > usable:
            yield Trouble(
                "threads",
                f"torch uses {self.torch} threads on {usable} cores",
                f"set OMP_NUM_THREADS={usable}",
            )


@dataclass(frozen=True)
class Memory:
    """Memory in bytes; None where the system does not say."""

    total: int | None
    available: int | None
    shared: int | None
    """Size of /dev/shm, through which workers that load scans hand them over."""

    def troubles(self) -> Iterator[Trouble]:
        """Too little of it."""
        if self.available is not None and self.available < _LEAST_MEMORY:
            yield Trouble(
                "memory",
                f"{self.available / 1e9:.1f} GB are available",
                "stop other programs; trainings need some 2 GB, evaluations 1 GB",
            )
        if self.shared is not None and self.shared < 128 << 20:
            yield Trouble(
                "memory",
                f"/dev/shm holds {self.shared / 1e6:.0f} MB",
                "train with sampling.workers=0, or start the container with --shm-size=1g",
            )


@dataclass(frozen=True)
class Gpu:
    """What torch was built for, and what it finds."""

    build: str
    """``cpu``, ``CUDA 12.4``, ``ROCm 6.1``; empty where torch cannot be imported."""
    devices: tuple[str, ...]
    driver: bool
    """Whether there is a driver of NVIDIA."""

    def troubles(self) -> Iterator[Trouble]:
        """A GPU that torch does not use."""
        if self.driver and not self.devices:
            build = f"torch is built for {self.build}" if self.build else "torch is not there"
            yield Trouble(
                "GPU",
                f"there is a driver of NVIDIA, and {build}, which finds no GPU",
                "install torch as pytorch.org says for this driver",
            )


def find_processor() -> Processor:
    """The processor as the system describes it."""
    cores = os.cpu_count() or 1
    allowed = cores
    if hasattr(os, "sched_getaffinity"):
        allowed = len(os.sched_getaffinity(0))
    load = None
    with suppress(OSError, AttributeError):
        load = os.getloadavg()[0]
    info = _text(Path("/proc/cpuinfo"))
    named = re.search(r"^model name\s*: (.+)$", info, re.MULTILINE)
    name = named[1].strip() if named else platform.processor() or platform.machine()
    return Processor(name, _vectors(info), cores, allowed, _quota(), load)


def find_threads() -> Threads:
    """The threads of torch and numba in this process."""
    torch_threads = numba_threads = None
    with suppress(ImportError, OSError):
        import torch

        torch_threads = torch.get_num_threads()
    with suppress(ImportError, OSError):
        import numba

        numba_threads = numba.get_num_threads()
    limits = {name: os.environ[name] for name in _THREAD_VARIABLES if name in os.environ}
    return Threads(torch_threads, numba_threads, limits)


def find_memory() -> Memory:
    """Memory as the system tells it, and as a container limits it."""
    values = {
        name: int(kilobytes) * 1024
        for name, kilobytes in re.findall(
            r"^(\w+):\s+(\d+) kB$", _text(Path("/proc/meminfo")), re.M
        )
    }
    total, available = values.get("MemTotal"), values.get("MemAvailable")
    limit = _text(Path("/sys/fs/cgroup/memory.max")).strip()
    if limit.isdigit() and total is not None and int(limit) < total:
        total = int(limit)
        used = _text(Path("/sys/fs/cgroup/memory.current")).strip()
        free = total - int(used) if used.isdigit() else total
        available = free if available is None else min(free, available)
    shared = None
    with suppress(OSError):
        shared = shutil.disk_usage("/dev/shm").total
    return Memory(total, available, shared)


def find_gpu() -> Gpu:
    """The GPUs that torch finds."""
    driver = Path("/proc/driver/nvidia/version").exists()
    try:
        import torch
    except (ImportError, OSError):
        return Gpu("", (), driver)
    build = "cpu"
    if torch.version.cuda:
        build = f"CUDA {torch.version.cuda}"
    elif torch.version.hip:
        build = f"ROCm {torch.version.hip}"
    devices = []
    if torch.cuda.is_available():
        for number in range(torch.cuda.device_count()):
            properties = torch.cuda.get_device_properties(number)
            devices.append(f"{properties.name}, {properties.total_memory / 1e9:.0f} GB")
    elif torch.backends.mps.is_available():
        devices.append("Apple MPS")
    return Gpu(build, tuple(devices), driver)


def _vectors(info: str) -> str:
    found = re.search(r"^(?:flags|Features)\s*: (.+)$", info, re.MULTILINE)
    flags = set(found[1].split()) if found else set()
    names = {"avx512f": "AVX-512", "avx2": "AVX2", "avx": "AVX", "asimd": "NEON", "sse2": "SSE"}
    return next((name for flag, name in names.items() if flag in flags), "")


def _quota() -> float | None:
    """The cores that the control group of this process grants."""
    limit, _, period = _text(Path("/sys/fs/cgroup/cpu.max")).strip().partition(" ")
    if not limit:
        limit = _text(Path("/sys/fs/cgroup/cpu/cpu.cfs_quota_us")).strip()
        period = _text(Path("/sys/fs/cgroup/cpu/cpu.cfs_period_us")).strip()
    if not limit.isdigit() or not period.isdigit():
        return None
    return int(limit) / int(period)


def _text(path: Path) -> str:
    """A file of the system; empty where there is none."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
