"""Runs commands in forks of one process that has imported everything: a kill then hits the work.

Reads one request per line from standard input, as JSON, and answers each with one line. The answer
to {"start": [...], "cwd": ..., "log": ...} is the process number, to {"wait": pid} the exit status.
"""

import json
import os
import sys
import traceback
from importlib import import_module

#: What the commands import, except what starts threads, which a fork does not take along.
MODULES = (
    "deepring.cli.main",
    "deepring.cli.compare_command",
    "deepring.cli.loops_command",
    "deepring.cli.map_command",
    "deepring.cli.report_command",
    "deepring.cli.simulate_command",
    "deepring.cli.tables_command",
    "deepring.cli.train_commands",
    "deepring.experiment.sweep",
    "deepring.experiment.train",
    "deepring.localization.drives.loops",
    "deepring.methods.deepring",
    "deepring.rasters._bev_kernels",
    "deepring.search._correlation_kernels",
)


def serve():
    for module in MODULES:
        import_module(module)
    print("ready", flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        answer = start(request) if "start" in request else wait(request["wait"])
        print(answer, flush=True)


def start(request):
    pid = os.fork()
    if pid == 0:
        os._exit(run(request))
    return pid


def run(request):
    """Run a command as a process group of its own; its exit status."""
    from deepring.cli.main import main

    os.setpgid(0, 0)
    log = os.open(request["log"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for number, file in ((0, nothing), (1, log), (2, log)):
        os.dup2(file, number)
    os.chdir(request["cwd"])
    sys.argv = ["deepring", *request["start"]]
    try:
        main(request["start"])
        status = 0
    except SystemExit as stopped:
        status = int(stopped.code or 0)
    except BaseException:
        traceback.print_exc()
        status = 99
    sys.stdout.flush()
    sys.stderr.flush()
    return status


def wait(pid):
    """The exit status of a process; negative for the signal that ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


if __name__ == "__main__":
    serve()
