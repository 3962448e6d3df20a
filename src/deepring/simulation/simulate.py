"""Simulates two drives through one world and writes them in a layout."""

import multiprocessing
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from numpy.typing import NDArray

from deepring import checks
from deepring.data.scans.columns import label_path
from deepring.data.scans.labels import write_labels
from deepring.progress import Progress
from deepring.simulation import custom_writer, manifest, mulran_writer, nclt_writer
from deepring.simulation.drive import Drive
from deepring.simulation.mounting import Sensor
from deepring.simulation.scene import Scene, scene_of
from deepring.simulation.sensors import Sweep
from deepring.simulation.settings import SimulationSettings

_BATCH = 8  # scans per task of a worker


class Writer(Protocol):
    """The interface of a layout's module, e.g. `nclt_writer`."""

    SESSIONS: tuple[str, str]

    def scan_path(self, root: Path, session: str, stamp: int, /) -> Path:
        """Path of the scan of a stamp (microseconds)."""

    def pose_files(self, root: Path, session: str, /) -> list[Path]:
        """The files of `write_poses`."""

    def in_file_order(self, rays: NDArray, sweep: Sweep, /) -> NDArray:
        """Values (n, ...) in the order of a scan's records, of values (C, B, ...) of all rays."""

    def write_scan(self, path: Path, sweep: Sweep, sensor: Sensor, /) -> None:
        """Write one sweep."""

    def write_poses(self, root: Path, session: str, drive: Drive, /) -> None:
        """Write one session's poses and stamps."""

    def common_files(self, root: Path, /) -> list[Path]:
        """The files of `write_common`."""

    def write_common(self, root: Path, sensors: Sequence[Sensor], /) -> None:
        """Write what describes both sessions; ``sensors`` are theirs."""


@dataclass(frozen=True)
class _ScanTask:
    """One scan to write: its settings, session (0 or 1), index and file."""

    settings: SimulationSettings
    session: int
    index: int
    path: Path

    @property
    def files(self) -> list[Path]:
        """The scan's file, and that of its labels if there is one."""
        return [self.path, label_path(self.path)] if self.settings.labels else [self.path]


def simulate(
    settings: SimulationSettings,
    root: Path,
    *,
    workers: int = 1,
    progress: Progress | None = None,
) -> Path:
    """Write both sessions of ``settings`` below ``root`` and return ``root``.

    An interrupted run continues where it stopped; every scan has its own random numbers, so that
    neither interruptions nor the number of ``workers`` (processes) change the result. ``progress``
    is called with the numbers of written scans and of all scans. A complete dataset is not changed.
    Raises FileError, without changes, if ``root`` holds other data, and ConfigError for fewer than
    one worker.
    """
    checks.count("workers", workers)
    root = Path(root)
    if manifest.claim(root, settings):
        return root
    scene = scene_of(settings)
    _write_poses(scene, root)
    tasks = _tasks(scene, root)
    _write_scans(tasks, workers, progress)
    _finish(scene, root, tasks)
    return root


def session_names(settings: SimulationSettings) -> tuple[str, str]:
    """Folder names of the database and the query session."""
    return _writer(settings).SESSIONS


def _finish(scene: Scene, root: Path, tasks: Sequence[_ScanTask]) -> None:
    writer = _writer(scene.settings)
    written = [path for task in tasks for path in task.files]
    scans = Counter(path.parent.relative_to(root).as_posix() for path in written)
    files = [path for name in writer.SESSIONS for path in writer.pose_files(root, name)]
    files += writer.common_files(root)
    poses = [path.relative_to(root).as_posix() for path in files]
    manifest.finish(root, scene.settings, dict(scans), poses)


def _tasks(scene: Scene, root: Path) -> list[_ScanTask]:
    """Every scan of both sessions, in driving order."""
    settings, scan_path = scene.settings, _writer(scene.settings).scan_path
    return [
        _ScanTask(settings, session, index, scan_path(root, name, stamp))
        for session, name in enumerate(session_names(settings))
        for index, stamp in enumerate(scene.drives[session].scan_stamps.tolist())
    ]


def _write_poses(scene: Scene, root: Path) -> None:
    writer = _writer(scene.settings)
    for name, drive in zip(writer.SESSIONS, scene.drives, strict=True):
        if not all(path.is_file() for path in writer.pose_files(root, name)):
            writer.write_poses(root, name, drive)
    if not all(path.is_file() for path in writer.common_files(root)):
        writer.write_common(root, scene.sensors)


def _write_scans(tasks: Sequence[_ScanTask], workers: int, progress: Progress | None) -> None:
    """Write the missing scans."""
    missing = [task for task in tasks if not all(path.is_file() for path in task.files)]
    for count, _ in enumerate(_each(missing, workers), len(tasks) - len(missing) + 1):
        if progress is not None:
            progress(count, len(tasks))


def _each(tasks: Sequence[_ScanTask], workers: int) -> Iterator[None]:
    if workers == 1 or len(tasks) < 2:
        yield from map(_write_scan, tasks)
        return
    with multiprocessing.get_context("spawn").Pool(min(workers, len(tasks))) as pool:
        yield from pool.imap_unordered(_write_scan, tasks, chunksize=_BATCH)


def _write_scan(task: _ScanTask) -> None:
    scene = scene_of(task.settings)
    sweep = scene.sweep(task.session, task.index)
    writer = _writer(task.settings)
    if task.settings.labels:
        write_labels(task.path, writer.in_file_order(sweep.labels, sweep))
    writer.write_scan(task.path, sweep, scene.sensors[task.session])


def _writer(settings: SimulationSettings) -> Writer:
    writers: dict[str, Writer] = {
        "nclt": nclt_writer,
        "mulran": mulran_writer,
        "custom": custom_writer,
    }
    return writers[settings.layout]
