"""How far long work is: bars on a terminal, lines without one."""

import io
import os
import pty
import re
import subprocess
import sys

import pytest
from rich.console import Console

from deepring import progress
from deepring.progress import ProgressLines, duration_text, progress_bar, rate_text


class Clock:
    """A clock that stands until it is told to go on."""

    now = 100.0

    def __call__(self):
        return self.now


def said(capsys):
    return capsys.readouterr().err.splitlines()


def go_through(lines, clock, total, seconds_each):
    for done in range(1, total + 1):
        clock.now += seconds_each
        lines(done, total)
    lines.end()


def test_quick_work_says_nothing(capsys):
    clock = Clock()
    go_through(ProgressLines("reading", clock), clock, 19, 0.1)
    assert said(capsys) == []


def test_lines_come_after_2_12_42_seconds_and_then_every_minute(capsys):
    clock = Clock()
    go_through(ProgressLines("reading", clock), clock, 200, 1.0)
    lines = said(capsys)
    assert [int(line.split()[1]) for line in lines] == [2, 12, 42, 102, 162, 200]
    assert lines[0] == "reading: 2 of 200 (1 %), 1.0/s, 3:18 min left"
    assert lines[-1] == "reading: 200 in 3:20 min"


def test_what_was_there_and_the_start_do_not_count_for_the_rate(capsys):
    clock = Clock()
    lines = ProgressLines("rasters", clock)
    clock.now += 3  # until the first is done, workers start
    lines(300, 1000)  # found in the cache
    clock.now += 10
    lines(310, 1000)
    assert said(capsys) == [
        "rasters: 300 of 1000 (30 %)",
        "rasters: 310 of 1000 (31 %), 1.0/s, 11:30 min left",
    ]


def test_work_whose_end_is_not_known_says_how_long_it_took(capsys):
    clock = Clock()
    lines = ProgressLines("a bag", clock)
    for done in range(1, 6):
        clock.now += 1
        lines(done, done)
    lines.end()
    assert said(capsys) == ["a bag: 5 in 5 s"]


def test_nothing_is_said_where_several_processes_share_a_terminal(capsys, monkeypatch):
    monkeypatch.setattr(progress, "_silent", True)
    monkeypatch.setattr(progress, "_FIRST", 0.0)
    with progress_bar("work") as bar:
        bar(1, 2)
    assert said(capsys) == []


def test_a_title_is_printed_on_one_line(capsys, monkeypatch):
    monkeypatch.setattr(progress, "_FIRST", 0.0)
    with progress_bar("a\x1b[31m\nb") as bar:
        bar(1, 2)
    first, last = said(capsys)
    assert first.startswith(r"a\x1b[31m\nb: 1 of 2 (50 %)")
    assert last.startswith(r"a\x1b[31m\nb: 1 in 0 s")


def test_work_that_fails_says_no_end(capsys, monkeypatch):
    monkeypatch.setattr(progress, "_FIRST", 0.0)
    with pytest.raises(ValueError, match="no"), progress_bar("work"):
        raise ValueError("no")
    assert said(capsys) == []


@pytest.mark.parametrize("environment", [{"FORCE_COLOR": "1"}, {"TTY_COMPATIBLE": "1"}])
def test_a_file_gets_no_control_characters_whatever_the_environment(
    capsys, monkeypatch, environment
):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(progress, "_FIRST", 0.0)
    with progress_bar("work") as bar:
        bar(1, 2)
    assert all(line.isprintable() for line in said(capsys))


@pytest.mark.parametrize("kind", ["dumb", "unknown", None])
def test_a_terminal_that_cannot_draw_gets_lines(monkeypatch, kind):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(sys, "stderr", Terminal())
    if kind is None:
        monkeypatch.delenv("TERM", raising=False)
    else:
        monkeypatch.setenv("TERM", kind)
    assert not progress.draws_bars()
    monkeypatch.setenv("TERM", "xterm-256color")
    assert progress.draws_bars()


#: Work with a warning and a log line in the middle of it, on a terminal.
ON_TERMINAL = """
import logging, sys, time
from deepring.cli.stderr_handler import StderrHandler
from deepring.progress import progress_bar

logging.basicConfig(handlers=[StderrHandler()], level=logging.INFO, format="%(message)s")
with progress_bar("reading") as bar:
    for k in range(4):
        bar(k + 1, 4)
        time.sleep(0.15)
        if k == 1:
            print("warning: in between", file=sys.stderr)
            logging.info("and a line of the log")
print("the result")
"""


def on_terminal(code):
    """What a program writes on a terminal of 80 columns, standard error there, and on a pipe."""
    leader, follower = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "80"}
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=follower,
        text=True,
        env=environment,
    )
    os.close(follower)
    drawn = b""
    while True:
        try:
            part = os.read(leader, 4096)
        except OSError:  # the last writer has closed it
            break
        if not part:
            break
        drawn += part
    os.close(leader)
    out = process.communicate()[0]
    assert process.returncode == 0
    return drawn.decode(), out


def test_a_terminal_gets_a_bar_with_rate_and_time_left_and_whole_lines_above_it():
    drawn, out = on_terminal(ON_TERMINAL)
    assert out == "the result\n"  # nothing of the bar on standard output
    plain = re.sub(r"\x1b\[[?0-9;]*[A-Za-z]", "", drawn)
    assert re.search(r"reading ━+.* 2/4 .*\d s left", plain)
    assert re.search(r"\d(\.\d)?/s", plain)
    lines = [line.strip() for line in re.split(r"[\r\n]+", plain)]
    assert "warning: in between" in lines
    assert "and a line of the log" in lines
    # The bar is gone in the end: its line was erased.
    assert "\x1b[2K" in drawn[-40:]


def test_a_long_title_is_cut_and_the_numbers_stay():
    clock = Clock()
    bar = progress._bar()
    bar.get_time = clock
    title = "DeepRING trained on many streets, tested on others: describing and looking up"
    task = bar.add_task(title, total=None)
    shown = io.StringIO()
    Console(file=shown, width=80).print(bar.get_renderable())
    assert "?" not in shown.getvalue(), "before the number is known"
    bar.update(task, total=9000)
    for done in (1800, 1900, 2000):
        clock.now += 10
        bar.update(task, completed=done)
    shown = io.StringIO()
    Console(file=shown, width=80).print(bar.get_renderable())
    (line,) = shown.getvalue().splitlines()
    assert len(line) == 80
    assert line.startswith("DeepRING trained on")
    assert "… ━" in line
    assert line.endswith("2000/9000 10/s 11:40 min left")


def test_texts_of_rates_and_durations_change_their_unit():
    assert rate_text(10.4) == "10/s"
    assert rate_text(0.01) == "100.0 s each"
    assert duration_text(59.6) == "1:00 min"
    assert duration_text(3599.7) == "1:00 h"
