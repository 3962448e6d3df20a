"""Everything that a bug report needs to say of an installation and its machine."""

import platform
import sys
from dataclasses import dataclass
from pathlib import Path

from deepring import __version__
from deepring.diagnosis.folders import Folder, find_folders
from deepring.diagnosis.machine import (
    Gpu,
    Memory,
    Processor,
    Threads,
    find_gpu,
    find_memory,
    find_processor,
    find_threads,
)
from deepring.diagnosis.packages import Packages, find_packages
from deepring.diagnosis.timings import Timing, measure
from deepring.diagnosis.trouble import Trouble
from deepring.errors import DeepringError
from deepring.progress import Progress


@dataclass(frozen=True)
class Diagnosis:
    """An installation, its machine, and what is wrong or slow."""

    version: str
    python: str
    system: str
    executable: Path
    package: Path
    """The folder of the package."""
    packages: Packages
    processor: Processor
    threads: Threads
    memory: Memory
    gpu: Gpu
    folders: list[Folder]
    timings: list[Timing]
    troubles: list[Trouble]

    @property
    def works(self) -> bool:
        """Whether nothing was found by which commands fail."""
        return not any(trouble.fails for trouble in self.troubles)


def diagnose(cache: Path, progress: Progress) -> Diagnosis:
    """Look at the installation and the machine; ``cache`` is the folder of the raster cache.

    ``progress`` is told how many steps of the commands are measured.

    Takes some seconds, as the steps of the commands are measured. Nothing is written but what those
    steps write themselves: compiled loops.
    """
    packages, processor = find_packages(), find_processor()
    timings, failures = _timings(progress)
    threads, memory, gpu = find_threads(), find_memory(), find_gpu()
    folders = find_folders(cache)
    troubles = [*packages.troubles(), *failures, *processor.troubles()]
    troubles += [*threads.troubles(processor.usable), *memory.troubles(), *gpu.troubles()]
    troubles += [trouble for folder in folders for trouble in folder.troubles()]
    troubles += [trouble for timing in timings for trouble in timing.troubles()]
    return Diagnosis(
        version=__version__,
        python=f"{platform.python_implementation()} {platform.python_version()}",
        system=platform.platform(),
        executable=Path(sys.executable),
        package=Path(__file__).resolve().parents[1],
        packages=packages,
        processor=processor,
        threads=threads,
        memory=memory,
        gpu=gpu,
        folders=folders,
        timings=timings,
        troubles=sorted(troubles, key=lambda trouble: not trouble.fails),
    )


def _timings(progress: Progress) -> tuple[list[Timing], list[Trouble]]:
    """The times of the steps, or why they cannot be done, whatever the cause."""
    try:
        return measure(progress), []
    except DeepringError as error:
        return [], [Trouble("network", str(error), "install deepring again", fails=True)]
    except Exception as error:
        name = type(error).__name__
        cause = f"a step of the commands fails with {name}"
        if isinstance(error, ImportError):
            cause = f"{error.name or 'a package'} cannot be imported ({name})"
        advice = "install deepring and its packages again, in an environment of their own"
        return [], [Trouble("packages", cause, advice, fails=True)]
