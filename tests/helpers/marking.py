"""Things that leave a mark when they are imported, called or unpickled."""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

MODULE = "marking_module"

#: A class of that module, as files name classes.
TARGET = f"{MODULE}.Anything"


class Mark:
    """Where a mark would be; its module lies on Python's path."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "mark"
        self.modules = folder / "modules"
        self.modules.mkdir()
        text = f"import os\nos.mkdir({str(self.path)!r})\nclass Anything: pass\n"
        (self.modules / f"{MODULE}.py").write_text(text, encoding="utf-8")

    @contextlib.contextmanager
    def unmarked(self) -> Iterator[None]:
        """Nothing of the module is imported in the block, and nothing makes the mark."""
        sys.path.insert(0, str(self.modules))
        try:
            yield
        finally:
            sys.path.remove(str(self.modules))
            imported = sys.modules.pop(MODULE, None)
        assert imported is None
        assert not self.path.exists()


class Marked:
    """Makes a folder when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple:
        return os.mkdir, (str(self.path),)
