"""The client of `fork_server`: starts commands, kills them, and waits for them."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

SERVER = Path(__file__).with_name("fork_server.py")


class Forks:
    def __init__(self, server):
        self.server = server

    def start(self, arguments, folder):
        """Start a command in a folder; its process number. Its output is added to `log.txt`."""
        request = {"start": [str(a) for a in arguments], "cwd": str(folder)}
        return self._ask(request | {"log": str(folder / "log.txt")})

    def wait(self, pid):
        return self._ask({"wait": pid})

    def run(self, arguments, folder):
        """Run a command to its end: its seconds. It must succeed."""
        begin = time.monotonic()
        status = self.wait(self.start(arguments, folder))
        assert status == 0, (folder / "log.txt").read_text()
        return time.monotonic() - begin

    def run_and_kill(self, arguments, folder, seconds):
        """Kill a command and its processes after some time; whether it was still running."""
        pid = self.start(arguments, folder)
        time.sleep(seconds)
        self.kill(pid)
        return self.wait(pid) == -signal.SIGKILL

    @staticmethod
    def kill(pid):
        with suppress(ProcessLookupError):  # before it has its own group
            os.kill(pid, signal.SIGKILL)
        with suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)

    def _ask(self, request):
        self.server.stdin.write(json.dumps(request) + "\n")
        self.server.stdin.flush()
        return int(self.server.stdout.readline())


@contextmanager
def fork_server():
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "COLUMNS": "120"}
    with subprocess.Popen(
        [sys.executable, "-W", "ignore", str(SERVER)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    ) as server:
        assert server.stdout.readline() == "ready\n"
        yield Forks(server)
        server.stdin.close()
