"""`deepring train` as a script file: Lightning starts it for each further process of a DDP run.

However the first process was started, as a command, with ``python -m`` or from Python, Lightning
starts this file, and the modules that the first finds are found here.
"""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

#: The environment variable that holds the first process's ``sys.path``.
PATHS = "DEEPRING_DDP_PATHS"


@contextmanager
def restartable(arguments: Sequence[str]) -> Iterator[None]:
    """Let Lightning start this file with these arguments in the block; Hydra takes them, too.

    Lightning starts ``python sys.argv[0] sys.argv[1:]``, or ``python -m`` and the name of the main
    module where that has one, which would lack the name of the command.
    """
    started, spec = sys.argv, sys.modules["__main__"].__spec__
    sys.argv = [str(Path(__file__)), *arguments]
    sys.modules["__main__"].__spec__ = None
    os.environ[PATHS] = os.pathsep.join(str(Path(path).absolute()) for path in sys.path)
    try:
        yield
    finally:
        sys.argv, sys.modules["__main__"].__spec__ = started, spec


if __name__ == "__main__":
    # In place of this file's folder, whose modules have names that others may have.
    sys.path[:] = os.environ[PATHS].split(os.pathsep) if PATHS in os.environ else sys.path[1:]
    from deepring.cli.main import main

    main(["train", *sys.argv[1:]])
