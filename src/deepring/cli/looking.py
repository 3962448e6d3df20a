"""What `--page`, `--view` and `--view-file` ask for: a page, a viewer, a file for the viewer."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from deepring.cli.options import expect_new
from deepring.errors import ConfigError
from deepring.io.files import write_whole
from deepring.text import printable

if TYPE_CHECKING:
    from deepring.reports.scene import Scene

#: How the names of the files end.
_ENDINGS = {"page": ".html", "view_file": ".rrd"}


def expect_lookable(args: argparse.Namespace, *others: Path) -> None:
    """Raise ConfigError or FileError for a page or a view that cannot be, before any work is done.

    ``others`` are the other files that the command is going to write.
    """
    taken = {other.resolve() for other in others}
    for name, ending in _ENDINGS.items():
        path: Path | None = getattr(args, name, None)
        if path is None:
            continue
        if path.suffix.lower() != ending:
            raise ConfigError(f"{name}: {path}, expected a name that ends in {ending}")
        if path.resolve() in taken:
            raise ConfigError(f"{name}: {path} is another output too, expected a name of its own")
        taken.add(path.resolve())
        expect_new(path, name)
    if args.view or args.view_file is not None:
        from deepring.reports.viewer import expect_display, rerun

        rerun("view" if args.view else "view_file")
        if args.view:
            expect_display()


def is_viewed(args: argparse.Namespace) -> bool:
    """Whether the command makes a scene."""
    return bool(args.view) or args.view_file is not None


def is_shown(args: argparse.Namespace) -> bool:
    """Whether the command makes a scene or a page."""
    return is_viewed(args) or args.page is not None


def write_page(args: argparse.Namespace, page: str) -> None:
    """Write the page, and say so on standard error, apart from the command's result."""
    write_whole(args.page, [page.encode()])
    _say_written(args.page)


def show_scene(args: argparse.Namespace, make: "Callable[[], Scene]") -> None:
    """Open the viewer on the scene that is made, and write its file, as the options ask for."""
    if not is_viewed(args):
        return
    from deepring.reports.viewer import save_view, view

    scene = make()
    if args.view_file is not None:
        save_view(scene, args.view_file)
        _say_written(args.view_file)
    if args.view:
        view(scene)


def _say_written(path: Path) -> None:
    print(f"note: written {printable(str(path))}", file=sys.stderr)
