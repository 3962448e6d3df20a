"""A diagnosis as text to paste into a bug report, and as values for JSON."""

import getpass
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from textwrap import wrap
from typing import Any

from deepring.diagnosis.diagnosis import Diagnosis
from deepring.diagnosis.folders import Folder
from deepring.diagnosis.machine import Processor
from deepring.diagnosis.packages import Package
from deepring.diagnosis.timings import time_text
from deepring.text import printable

Hide = Callable[[str], str]

_WIDTH, _NAMES = 80, 20


def as_text(diagnosis: Diagnosis, hide: Hide) -> str:
    """Lines of names and values, at most 80 characters wide but for long paths, which stay whole.

    What is wrong or slow stands at the end.

    ``hide`` takes out of a text what is not to be told.
    """
    lines: list[str] = []
    for name, value in _facts(diagnosis):
        lines += _hanging(name, printable(hide(value)))
    for fails, title in ((True, "commands fail by"), (False, "slow or doubtful")):
        found = [trouble for trouble in diagnosis.troubles if trouble.fails is fails]
        lines += ["", f"{title}:"] if found else []
        for trouble in found:
            lines += _wrapped(f"- {printable(hide(str(trouble)))}", "  ")
    if not diagnosis.troubles:
        lines += ["", "nothing wrong was found, and nothing slow"]
    return "\n".join(lines)


def as_values(diagnosis: Diagnosis, hide: Hide) -> dict[str, Any]:
    """The diagnosis as plain values; sizes are in bytes, times in milliseconds."""
    packages = diagnosis.packages
    return {
        "works": diagnosis.works,
        "version": diagnosis.version,
        "python": diagnosis.python,
        "system": diagnosis.system,
        "executable": hide(str(diagnosis.executable)),
        "package": hide(str(diagnosis.package)),
        "packages": [asdict(one) for one in packages.required],
        "extras": {name: [asdict(one) for one in of] for name, of in packages.extras.items()},
        "processor": {**asdict(diagnosis.processor), "usable": diagnosis.processor.usable},
        "threads": asdict(diagnosis.threads),
        "memory": asdict(diagnosis.memory),
        "gpu": {**asdict(diagnosis.gpu), "devices": list(diagnosis.gpu.devices)},
        "folders": [_folder_values(folder, hide) for folder in diagnosis.folders],
        "timings": [asdict(timing) for timing in diagnosis.timings],
        "troubles": [
            {**asdict(one), "found": hide(one.found), "advice": hide(one.advice)}
            for one in diagnosis.troubles
        ],
    }


def without_names(text: str) -> str:
    """The text without the path of the home folder and without the user's name."""
    for name in dict.fromkeys((str(Path.home()), str(Path.home().resolve()))):
        if len(name) > 1:
            text = text.replace(name, "~")
    text = re.sub(r"(?<![\w.~-])(/(?:home|Users)/)[^/\s:]+", r"\1USER", text)
    try:
        user = getpass.getuser()
    except (OSError, KeyError, ImportError):  # a container without an entry for the user
        return text
    return re.sub(rf"\b{re.escape(user)}\b", "USER", text) if user != "root" else text


def _facts(diagnosis: Diagnosis) -> Iterator[tuple[str, str]]:
    yield "deepring", f"{diagnosis.version}, in {diagnosis.package}"
    yield "Python", f"{diagnosis.python}, {diagnosis.executable}"
    yield "system", diagnosis.system
    yield "packages", ", ".join(map(_package, diagnosis.packages.required)) or "not known"
    for name, of in diagnosis.packages.extras.items():
        yield f"extra {name}", _extra(of)
    yield "processor", _processor(diagnosis.processor)
    threads = diagnosis.threads
    limits = ", ".join(f"{name}={value}" for name, value in threads.limits.items())
    yield "threads", f"torch {threads.torch}, numba {threads.numba}; " + (limits or "no limit set")
    total, available = (
        _gigabytes(of) for of in (diagnosis.memory.total, diagnosis.memory.available)
    )
    yield "memory", f"{total}, {available} available"
    devices = "; ".join(diagnosis.gpu.devices) or "none"
    yield "GPU", f"{devices}; torch is built for {diagnosis.gpu.build or 'nothing'}"
    for folder in diagnosis.folders:
        yield folder.what, _folder(folder)
    for timing in diagnosis.timings:
        yield timing.step, f"{time_text(timing.milliseconds)} (docs: {time_text(timing.stated)})"


def _package(package: Package) -> str:
    return f"{package.name} {package.version or 'missing'}{'' if package.fits else ' (!)'}"


def _extra(packages: Sequence[Package]) -> str:
    if all(package.fits for package in packages):
        return "there: " + ", ".join(map(_package, packages))
    if not any(package.version for package in packages):
        return "not installed"
    return "in parts: " + ", ".join(map(_package, packages))


def _processor(processor: Processor) -> str:
    parts = [processor.name, processor.vectors]
    parts.append(f"{processor.usable} of {processor.cores} cores usable")
    if processor.load is not None:
        parts.append(f"load {processor.load:.1f}")
    return ", ".join(filter(None, parts))


def _folder(folder: Folder) -> str:
    state = "cannot be written" if folder.unwritable else "can be written"
    held = f"{folder.bytes / 1e6:.1f} MB" if folder.exists else "not there yet"
    held = f"{held}, " if folder.bytes or not folder.exists else ""
    free = f", {_gigabytes(folder.free)} free" if folder.free is not None else ""
    kind = f" ({folder.file_system})" if folder.file_system else ""
    return f"{folder.path}: {held}{state}{free}{kind}"


def _folder_values(folder: Folder, hide: Hide) -> dict[str, Any]:
    return {**asdict(folder), "path": hide(str(folder.path)), "writable": not folder.unwritable}


def _gigabytes(number: int | None) -> str:
    return "unknown" if number is None else f"{number / 1e9:.1f} GB"


def _hanging(name: str, value: str) -> list[str]:
    return _wrapped(f"{name:<{_NAMES}}{value}", " " * _NAMES)


def _wrapped(text: str, indent: str) -> list[str]:
    return wrap(
        text,
        _WIDTH,
        subsequent_indent=indent,
        break_on_hyphens=False,
        break_long_words=False,  # a path in a bug report is copied
    ) or [text]
