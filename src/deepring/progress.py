"""Progress bars for long work; silent where standard error is no terminal."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from deepring.text import printable

Progress = Callable[[int, int], None]
"""Called with the number of things done and their total."""

Bar = Callable[[str], AbstractContextManager[Progress]]
"""Opens a progress bar of a title."""

_silent = False


def silence() -> None:
    """Draw no bars in this process, for one that shares its terminal with others."""
    global _silent
    _silent = True


@contextmanager
def progress_bar(description: str) -> Iterator[Progress]:
    """A bar on standard error, gone when done; yields a function to call with (done, total)."""
    from rich import progress
    from rich.console import Console

    columns = (
        progress.TextColumn("{task.description}", markup=False),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    silent = _silent or not console.is_terminal
    with progress.Progress(*columns, console=console, transient=True, disable=silent) as bar:
        task = bar.add_task(printable(description), total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
