"""Lets Lightning start the further processes of a DDP run, however the first was started.

As a command, with ``python -m`` or from Python: Lightning starts `further_process`, a script file,
and the modules that the first process finds are found there.
"""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

#: The environment variable that holds the first process's ``sys.path``; see `further_process`.
PATHS = "DEEPRING_DDP_PATHS"


@contextmanager
def restartable(arguments: Sequence[str]) -> Iterator[None]:
    """Let Lightning start `further_process` with these arguments; Hydra takes them, too.

    Lightning starts ``python sys.argv[0] sys.argv[1:]``, or ``python -m`` and the name of the main
    module where that has one, which would lack the name of the command.
    """
    started, spec = sys.argv, sys.modules["__main__"].__spec__
    sys.argv = [str(Path(__file__).with_name("further_process.py")), *arguments]
    sys.modules["__main__"].__spec__ = None
    os.environ[PATHS] = os.pathsep.join(str(Path(path).absolute()) for path in sys.path)
    try:
        yield
    finally:
        sys.argv, sys.modules["__main__"].__spec__ = started, spec
