"""The data formats by name: open a session, list sessions, tell which format a folder has."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from deepring.data.readers.custom import LAYOUTS as OWN_LAYOUTS
from deepring.data.readers.custom import list_own, open_own
from deepring.data.readers.drive_file import is_drive_file
from deepring.data.readers.kitti import LAYOUTS as KITTI_LAYOUTS
from deepring.data.readers.kitti import list_kitti, open_kitti
from deepring.data.readers.listing import TITLES, existing_root, guess_formats, layout_error
from deepring.data.readers.mulran import LAYOUTS as MULRAN_LAYOUTS
from deepring.data.readers.mulran import list_mulran, open_mulran
from deepring.data.readers.nclt import LAYOUTS as NCLT_LAYOUTS
from deepring.data.readers.nclt import list_nclt, open_nclt
from deepring.data.session import Session
from deepring.errors import DeepringError


class Format(NamedTuple):
    """How one data format is opened (root, name, options) and its sessions are listed (root)."""

    open: Callable[..., Session]
    sessions: Callable[[Path | str], list[str]]
    layouts: tuple[str, ...]
    ground_z: float | None
    """z of the ground under the sensor in its scans' frame, metres, on the usual platform; None
    where each session says it."""


FORMATS: dict[str, Format] = {
    "nclt": Format(open_nclt, list_nclt, NCLT_LAYOUTS, 0.0),
    "mulran": Format(open_mulran, list_mulran, MULRAN_LAYOUTS, -1.8),
    "kitti": Format(open_kitti, list_kitti, KITTI_LAYOUTS, -1.73),
    "own": Format(open_own, list_own, OWN_LAYOUTS, None),
}


def open_session(format: str, root: Path | str, name: str | None = None, **options: Any) -> Session:
    """Open session ``name`` of the data set in ``root``; ``name`` may be left out if it has one.

    ``options`` go to the format's opener: ``pose_tolerance`` (nclt, mulran), ``extrinsic``
    (mulran). Raises DeepringError for an unknown format or option, and where the session cannot
    be opened.
    """
    chosen = _format(format)
    accepted = list(inspect.signature(chosen.open).parameters)[2:]
    for option in options:
        if option not in accepted:
            raise DeepringError(
                f"option {option!r} of format {format}; expected "
                f"{'one of ' + ', '.join(accepted) if accepted else 'none'}"
            )
    if name is None:
        names = list_sessions(format, root)
        if len(names) > 1:
            raise DeepringError(
                f"{root} holds {len(names)} sessions ({', '.join(names)}): name one"
            )
        name = names[0]
    try:
        return chosen.open(root, name, **options)
    except DeepringError as error:
        names = chosen.sessions(root) if Path(root).is_dir() else []
        if not names or name in names:
            raise
        raise DeepringError(
            f"no session {name!r} in {root}, which holds {', '.join(names)}; name one of these "
            "(data.database=..., data.query=...)"
        ) from error


def list_sessions(format: str, root: Path | str) -> list[str]:
    """Names of the sessions in ``root``, sorted. Raises DeepringError where there is none."""
    chosen = _format(format)
    names = chosen.sessions(root)
    if not names:
        raise layout_error("no scans of any session", existing_root(root), format, chosen.layouts)
    return names


def detect_format(root: Path | str) -> str:
    """Tell the format of the data set in ``root``: "nclt", "mulran" or "kitti"; "own" for a
    YAML file that describes drives.

    Raises DeepringError where it is none of them, or more than one.
    """
    if is_drive_file(root):
        return "own"
    base = existing_root(root)
    guesses = guess_formats(base)
    if len(guesses) == 1:
        return guesses[0]
    if guesses:
        raise DeepringError(
            f"{base} holds data of several formats ({', '.join(guesses)}): name one with --format, "
            "or give the folder of one data set"
        )
    layouts = "\n".join(
        f"  {TITLES[name]}: {layout}"
        for name, format in FORMATS.items()
        for layout in format.layouts
    )
    raise DeepringError(
        f"{base} holds no data set that is known here. Point data.root at the folder that holds "
        f"one of these:\n{layouts}"
    )


def ground_of(session: Session, format: str) -> float:
    """z of the ground under the sensor in a session's scans, metres: the session's own value, or
    the usual one of its format."""
    ground_z = _format(format).ground_z if session.ground_z is None else session.ground_z
    if ground_z is None:
        raise ValueError(f"format {format}: neither it nor session {session.name} has a ground_z")
    return ground_z


def _format(name: str) -> Format:
    if name not in FORMATS:
        raise DeepringError(f"format = {name!r}; expected one of {', '.join(FORMATS)}")
    return FORMATS[name]
