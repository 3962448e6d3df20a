"""How far long work is: a bar on a terminal, and now and then a line where there is none."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING

from deepring.text import printable

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

Progress = Callable[[int, int], None]
"""Called with the number of things done and their total."""

Bar = Callable[[str], AbstractContextManager[Progress]]
"""Opens a progress bar of a title."""

#: Seconds until the first line, and from each line to the next; the last one is repeated.
_FIRST, _BETWEEN = 2.0, (10.0, 30.0, 60.0)

_silent = False

Watcher = Callable[[str, int, int], None]
"""Called with the title of a work, the number of things done and their total."""

_watchers: list[Watcher] = []


@contextmanager
def watched(watcher: Watcher) -> Iterator[None]:
    """Within the block, ``watcher`` is told how far each work of this process is, too.

    It is called as often as the bar, and has to be quick.
    """
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)


def silence() -> None:
    """Say nothing in this process, for one that shares its terminal with others."""
    global _silent
    _silent = True


@contextmanager
def progress_bar(description: str) -> Iterator[Progress]:
    """Show on standard error how far work is; yields a function to call with (done, total).

    On a terminal it is a bar with a rate and the time left, which is gone when the work is done.
    Elsewhere, as in the log of a cluster, it is a line after two seconds, further ones after
    longer times, and one at the end; work of less than two seconds says nothing.
    """
    title = printable(description)
    if _silent:
        yield _told(title, _say_nothing)
    elif draws_bars():
        with _bar() as bar:
            task = bar.add_task(title, total=None)
            yield _told(title, lambda done, total: bar.update(task, completed=done, total=total))
    else:
        lines = ProgressLines(title)
        yield _told(title, lines)
        lines.end()


def _told(title: str, show: Progress) -> Progress:
    """Show how far it is, and tell the watchers."""

    def both(done: int, total: int) -> None:
        show(done, total)
        for watcher in _watchers:
            watcher(title, done, total)

    return both


def draws_bars() -> bool:
    """Whether standard error is a terminal on which a line can be drawn again."""
    return sys.stderr.isatty() and os.environ.get("TERM", "dumb") not in ("dumb", "unknown")


class ProgressLines:
    """Lines that say how far work is, without control characters.

    Args:
        title: what is done.
        clock: seconds; another one for tests.
    """

    def __init__(self, title: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.title, self.clock = title, clock
        self.started = clock()
        self.next, self.said = self.started + _FIRST, 0
        self.done = self.total = 0
        self.first: tuple[int, float] | None = None  # done at the first call, and when

    def __call__(self, done: int, total: int) -> None:
        """Note how far it is, and print a line if one is due."""
        self.done, self.total = done, total
        now = self.clock()
        if self.first is None:
            self.first = done, now
        if now >= self.next and done < total:
            self._print(self._how_far(now))
            self.next = now + _BETWEEN[min(self.said, len(_BETWEEN) - 1)]
            self.said += 1

    def end(self) -> None:
        """Print how much was done, and in what time, unless it was quick."""
        seconds = self.clock() - self.started
        if seconds >= _FIRST:
            self._print(f"{self.done} in {duration_text(seconds)}" if self.done else "done")

    def _how_far(self, now: float) -> str:
        """The share, and, by the time since the first was done, the rate and what is left."""
        share = f"{self.done} of {self.total} ({100 * self.done // self.total} %)"
        before, began = self.first or (0, now)
        if self.done <= before or now <= began:
            return share
        rate = (self.done - before) / (now - began)
        left = duration_text((self.total - self.done) / rate)
        return f"{share}, {rate_text(rate)}, {left} left"

    def _print(self, text: str) -> None:
        print(f"{self.title}: {text}", file=sys.stderr, flush=True)


def rate_text(per_second: float) -> str:
    """A rate: so many a second, or, below one, so many seconds each.

    >>> rate_text(1234.5), rate_text(3.14), rate_text(0.2)
    ('1230/s', '3.1/s', '5.0 s each')
    """
    if per_second >= 1:
        return f"{float(f'{per_second:.3g}'):.0f}/s" if per_second >= 10 else f"{per_second:.1f}/s"
    return f"{1 / per_second:.1f} s each"


def duration_text(seconds: float) -> str:
    """A time in the units that matter.

    >>> duration_text(7.4), duration_text(75), duration_text(7265)
    ('7 s', '1:15 min', '2:01 h')
    """
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60}:{whole % 60:02d} min"
    return f"{whole // 3600}:{whole % 3600 // 60:02d} h"


def _say_nothing(done: int, total: int) -> None:
    del done, total


def _bar() -> "RichProgress":
    """A bar of rich, above which lines on standard error are printed whole.

    Where the terminal is narrow, the title is cut, and the numbers stay.
    """
    from rich import progress
    from rich.console import Console
    from rich.table import Column
    from rich.text import Text

    class Title(progress.ProgressColumn):
        """The title on one line, as much of it as there is room for."""

        def render(self, task: progress.Task) -> Text:
            return Text(task.description, no_wrap=True, overflow="ellipsis")

    class Count(progress.MofNCompleteColumn):
        """How many of how many, once that is known."""

        def render(self, task: progress.Task) -> Text:
            return Text("") if task.total is None else super().render(task)

    class Rate(progress.ProgressColumn):
        """How many a second, or how long for each."""

        def render(self, task: progress.Task) -> Text:
            return Text(rate_text(task.speed) if task.speed else "", style="progress.data.speed")

    class Left(progress.ProgressColumn):
        """The time left, in the words of the lines."""

        max_refresh = 0.5

        def render(self, task: progress.Task) -> Text:
            left = task.time_remaining
            text = "" if left is None or task.finished else f"{duration_text(left)} left"
            return Text(text, style="progress.remaining")

    def whole() -> Column:
        return Column(no_wrap=True)

    columns = (
        Title(),
        progress.BarColumn(bar_width=20, table_column=whole()),
        Count(table_column=whole()),
        Rate(table_column=whole()),
        Left(table_column=whole()),
    )
    # Standard output stays as it is: what a command prints there may go into a file.
    return progress.Progress(
        *columns, console=Console(stderr=True), transient=True, redirect_stdout=False
    )
