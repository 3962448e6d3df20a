"""SIGTERM ends a command as Ctrl-C does, with a status of its own."""

import os
import signal
import subprocess
import sys
import time

import pytest

from deepring.cli import main as entry
from deepring.cli.stop_signals import INTERRUPTED, TERMINATED, sigterm_interrupts, stop_status


def terminate_itself(_=None):
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(1)  # the handler runs before this ends
    raise AssertionError("not interrupted")


def test_sigterm_interrupts_and_the_signal_is_as_before_afterwards():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), sigterm_interrupts():
        terminate_itself()
    assert stop_status() == TERMINATED == 143
    assert signal.getsignal(signal.SIGTERM) is before


def test_the_next_ctrl_c_is_no_sigterm():
    with pytest.raises(KeyboardInterrupt), sigterm_interrupts():
        raise KeyboardInterrupt
    assert stop_status() == INTERRUPTED == 130


def test_a_caller_that_ignores_sigterm_is_heeded():
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with sigterm_interrupts():
            os.kill(os.getpid(), signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_command_says_that_it_was_interrupted(monkeypatch, capsys):
    monkeypatch.setattr(entry, "run", terminate_itself)
    with pytest.raises(SystemExit) as stopped:
        entry.main(["schema"])
    assert stopped.value.code == TERMINATED
    assert capsys.readouterr().err == "interrupted\n"


FORKS = """
import os, signal, time
from deepring.cli.stop_signals import sigterm_interrupts
with sigterm_interrupts():
    if not (child := os.fork()):
        print("ready", flush=True)
        time.sleep(60)
    time.sleep(0.5)
    os.kill(child, signal.SIGTERM)
    assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGTERM
"""


def test_a_forked_process_ends_at_once():
    done = subprocess.run(
        [sys.executable, "-c", FORKS], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "ready\n", "")
