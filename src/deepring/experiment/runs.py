"""Folders of runs: search and reading."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from deepring.errors import DataError, FileError
from deepring.evaluation.results import read_results
from deepring.experiment.run_folder import read_config
from deepring.experiment.status import Status, read_status
from deepring.io.strict_json import read_json
from deepring.paper.seed_groups import Run


@dataclass(frozen=True)
class RunCollection:
    """Finished runs, and one line per other run: its name, and why it is left out."""

    runs: list[Run]
    notes: list[str]


def find_runs(paths: Sequence[str | Path]) -> RunCollection:
    """All runs in these folders, at any depth; a path may be a run folder itself.

    A run folder holds a ``status.json``; one that several paths lead to counts once. Raises
    FileError for a path that is not a folder or holds no run, and for a finished run whose files
    cannot be read, and DataError if no run has finished.
    """
    runs, notes = [], []
    for folder, status in _statuses([Path(path) for path in paths]):
        reason = _unusable(folder, status)
        if reason is None:
            runs.append(read_run(folder))
        else:
            whole = folder.resolve()
            notes.append(f"left out: {whole.parent.name}/{whole.name}: {reason}")
    if not runs:
        raise DataError(
            f"{', '.join(map(str, paths))}: no run with results; expected at least one; "
            + "; ".join(notes)
            + "; start the same training again to go on with what is left"
        )
    return RunCollection(runs, notes)


def read_run(folder: str | Path) -> Run:
    """The config, results, commits and training time of a finished run.

    Raises FileError with the file that is missing or cannot be read.
    """
    folder = Path(folder)
    config, status = read_config(folder / "config.yaml"), read_status(folder)
    results = read_results(folder / "results.csv")
    if not results:
        raise FileError(
            f"{folder / 'results.csv'}: holds no result; expected those of a finished run; run the "
            "evaluation again"
        )
    seconds = None if status is None else status.seconds
    return Run(str(folder), config, results, _commits(folder), seconds)


def _statuses(paths: Sequence[Path]) -> Iterator[tuple[Path, Status]]:
    folders = set()
    for path in paths:
        if not path.is_dir():
            raise FileError(
                f"{path}: no such folder; expected a sweep's or a run's; "
                "see outputs/sweeps, where `deepring train -m` writes"
            )
        run_folders = list(_run_folders(path))
        if not run_folders:
            raise FileError(
                f"{path}: no run in it (a folder with a status.json, as `deepring train` leaves); "
                "expected the folder of a sweep or a run; name one"
            )
        for folder in run_folders:
            status = read_status(folder)
            if folder.resolve() not in folders and status is not None:
                folders.add(folder.resolve())
                yield folder, status


def _run_folders(path: Path) -> Iterator[Path]:
    """Folders with a status, sorted; neither links nor hidden folders are followed."""
    for place, folders, files in os.walk(path):
        if "status.json" in files:
            yield Path(place)
        folders[:] = sorted(name for name in folders if not name.startswith("."))


def _unusable(folder: Path, status: Status) -> str | None:
    if status.state == "failed":
        return f"failed: {((status.error or '').strip() or 'no reason given').splitlines()[0]}"
    if status.state == "interrupted":
        return "unfinished: interrupted"
    if status.state != "finished":
        return f"unfinished: {_UNFINISHED[status.worker.lives if status.worker else None]}"
    if not (folder / "results.csv").is_file():
        return "not evaluated (evaluate=false): no results.csv"
    return None


#: What is said of a run that has not noted its end, by whether its process lives.
_UNFINISHED = {True: "still running", False: "killed", None: "still running, or killed"}


def _commits(folder: Path) -> list[str]:
    """The commits of ``versions.json`` and of the files that a resumed run has added."""
    commits = []
    for path in sorted(folder.glob("versions*.json")):
        try:
            commit = read_json(path.read_text(encoding="utf-8"))["git_commit"]
        except (OSError, ValueError, KeyError, TypeError):
            raise FileError(
                f"{path}: no git_commit can be read; expected the versions of a run; delete the "
                "file to go on without it"
            ) from None
        if not isinstance(commit, str | None):
            raise FileError(
                f"{path}: git_commit: a {type(commit).__name__}, expected text; delete the file to "
                "go on without it"
            )
        if commit is not None:
            commits.append(commit)
    return commits


def _listed(paths: Sequence[str | Path]) -> str:
    return ", ".join(map(str, paths))
