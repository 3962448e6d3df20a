"""The Python interpreters of the machine."""

import os
import shutil
from pathlib import Path


def find(version: str, path: str | None = None, pyenv: Path | None = None) -> Path | None:
    """The interpreter of a version such as "3.12", on the path or of pyenv; None without one."""
    found = shutil.which(f"python{version}", path=path)
    root = pyenv or Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    if found is not None and "shims" not in Path(found).parts:
        return Path(found)
    candidates = root.glob(f"versions/{version}.*/bin/python{version}")
    return max(candidates, key=_patch, default=None)


def _patch(interpreter: Path) -> tuple[int, ...]:
    numbers = interpreter.parts[-3].split(".")
    return tuple(int(number) if number.isdigit() else -1 for number in numbers)
