"""Scenes in the viewer of rerun, or in a file that it opens (https://rerun.io)."""

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from deepring import checks
from deepring.errors import ConfigError
from deepring.io.files import write_whole
from deepring.reports.scene import Points, Scene
from deepring.text import printable

#: The steps of a scene, as the viewer names them.
TIMELINE = "scan"


def rerun(argument: str = "view") -> Any:
    """The library. Raises ConfigError, about ``argument``, if it is not installed."""
    library = checks.installed(argument, "rerun", "rerun", "view")
    if not library.RecordingStream("deepring").is_enabled():
        raise ConfigError(
            f"{argument}: rerun is switched off in the environment, expected RERUN=1 or no such "
            "variable"
        )
    return library


def expect_display() -> None:
    """Raise ConfigError where no window can be opened."""
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise ConfigError(
            "view: there is no display for the viewer's window, expected one; write a file with "
            "`view_file`, and open it with rerun elsewhere"
        )


def view(scene: Scene) -> None:
    """Open the viewer, which stays open, and show the scene.

    Raises ConfigError if rerun is not installed or its viewer does not start.
    """
    library = rerun()
    stream = library.RecordingStream("deepring")
    try:
        stream.spawn()
    except Exception as error:  # of whatever kind: the viewer is another program
        raise ConfigError(
            "view: the viewer did not start, expected rerun's own program in the PATH; run "
            "pip install 'deepring[view]' again, or write a file with `view_file`"
        ) from error
    _log(library, stream, scene)
    stream.flush()


def save_view(scene: Scene, path: Path) -> None:
    """Write the scene as a file for the viewer, whole or not at all.

    Raises ConfigError if rerun is not installed, and FileError if the file cannot be written.
    """
    library = rerun()
    stream = library.RecordingStream("deepring")
    # Not by the library's own `save`, which waits for ever where the disk is full.
    memory = stream.memory_recording()
    _log(library, stream, scene)
    write_whole(path, [memory.drain_as_bytes()])


def _title(scene: Scene) -> str:
    """The scene's name, and what its coordinates are relative to."""
    name = printable(scene.name)
    if not scene.origin.any():
        return name
    x, y, z = scene.origin
    return f"{name}, relative to x {x:.0f}, y {y:.0f}, z {z:.0f} m"


def _log(library: Any, stream: Any, scene: Scene) -> None:
    stream.send_recording_name(_title(scene))
    for shape in scene.shapes:
        if isinstance(shape, Points):
            value = library.Points3D(
                _near(shape.positions, scene),
                colors=shape.colour,
                radii=shape.radius,
                labels=[printable(label) for label in shape.labels] or None,
                show_labels=len(shape.labels) == 1,
            )
            if shape.step is not None:
                stream.set_time(TIMELINE, sequence=shape.step)
            stream.log(shape.path, value, static=shape.step is None)
        else:
            strips = [_near(strip, scene) for strip in shape.strips]
            value = library.LineStrips3D(strips, colors=shape.colour, radii=shape.radius)
            stream.log(shape.path, value, static=True)


def _near(positions: Any, scene: Scene) -> Any:
    return (positions - scene.origin).astype(np.float32)
