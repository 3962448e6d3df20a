"""The wheel and the sdist: built, and held against each other and against what describes them."""

import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

from release.environment import CommandError
from release.outcome import NOT_CHECKED, PASSED
from release.requirements import ROOT


def build(folder: Path, source: Path = ROOT, kind: str = "") -> list[Path]:
    """Build the wheel and the sdist of a source, or one of them, into a folder."""
    options = [f"--{kind}"] if kind else []
    _run(sys.executable, "-m", "build", "--no-isolation", *options, "-o", str(folder), str(source))
    return sorted(folder.iterdir())


def wheel_of(files: list[Path]) -> Path:
    """The wheel among the files."""
    (wheel,) = (file for file in files if file.suffix == ".whl")
    return wheel


def check(files: list[Path], folder: Path) -> Iterator[tuple[str, str]]:
    """What is checked of the files, each with its result."""
    wheel = wheel_of(files)
    (sdist,) = (file for file in files if file.suffix == ".gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    (source,) = (path for path in folder.iterdir() if path.is_dir())
    again = wheel_of(build(folder / "again", source, "wheel"))
    different = differences(contents(wheel), contents(again))
    yield "a wheel from the sdist has the same contents", _result(different)
    yield "metadata of both (twine)", _tool("twine", "check", "--strict", *map(str, files))
    cited = f"\nversion: {wheel.name.split('-')[1]}\n"
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    yield "CITATION.cff has the version", _result([] if cited in text else [cited.strip()])
    yield "CITATION.cff is valid (cffconvert)", _tool("cffconvert", "--validate")


def contents(wheel: Path) -> dict[str, bytes]:
    """The files of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def differences(one: dict[str, bytes], other: dict[str, bytes]) -> list[str]:
    """The names of files that only one has, or that differ."""
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


def _result(different: list[str]) -> str:
    return f"failed: {', '.join(different[:5])}" if different else PASSED


def _tool(name: str, *arguments: str) -> str:
    found = shutil.which(name, path=str(Path(sys.executable).parent)) or shutil.which(name)
    if found is None:
        return f"{NOT_CHECKED}: {name} is not installed"
    try:
        _run(found, *arguments)
    except CommandError as error:
        print(error, file=sys.stderr)
        return f"failed: {name}"
    return PASSED


def _run(*command: str) -> None:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CommandError(f"{' '.join(command)}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
