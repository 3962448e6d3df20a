"""What the files of conf/ say: their values as Hydra composes them, and their comments."""

import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

Compose = Callable[..., Mapping[str, Any]]
"""compose(config), or compose(group, option): the values, interpolations as they are written."""


@contextmanager
def composed(folder: Path) -> Iterator[Compose]:
    """Within it, configs of ``folder`` can be composed."""
    from hydra import compose, initialize_config_dir
    from omegaconf import OmegaConf

    from deepring.experiment.config_groups import register_configs

    def values(group: str, option: str | None = None) -> Mapping[str, Any]:
        config = compose(*_composed_of(folder, group, option))
        return dict(OmegaConf.to_container(config, resolve=False))  # type: ignore[arg-type]

    register_configs()
    with initialize_config_dir(str(folder), version_base="1.3"), warnings.catch_warnings():
        # Nobody composes an option alone but this page.
        warnings.filterwarnings("ignore", message=".*Defaults list is missing `_self_`.*")
        yield values


def _composed_of(folder: Path, group: str, option: str | None) -> tuple[Any, ...]:
    """What Hydra composes for the values of an option: the option alone where that is possible."""
    if option is None:
        return (group,)
    file = folder / group / f"{option}.yaml"
    if file.is_file() and writes_globally(file):
        return "train", [f"{group}={option}"]
    return (f"{group}/{option}",)


def writes_globally(file: Path) -> bool:
    """Whether an option sets keys of the whole config, and not those of its group alone."""
    return "# @package _global_" in file.read_text(encoding="utf-8")


def head_of(file: Path) -> str:
    """The comment that a config file begins with, as a paragraph; a command in it as code."""
    lines = []
    for line in file.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        text = line.removeprefix("#").strip()
        if not text.startswith("@package"):
            lines.append(f"`{text}`\n\n" if text.startswith("deepring ") else f"{text} ")
    return "".join(lines).strip()


def comments_of(file: Path, key: str = "") -> dict[str, str]:
    """The comments of a YAML file by dotted key: those behind a value, or just above its key.

    Args:
        file: of conf/.
        key: of the node that the file's values are in.
    """
    text = file.read_text(encoding="utf-8")
    lines = text.splitlines()
    notes = {}
    for path, first, last in _positions(yaml.compose(text), key.split(".") if key else []):
        behind = re.search(r"\s#\s+(.*)$", lines[last])
        above = []
        line = first - 1
        while line > 0 and re.match(r"\s+# ", lines[line]):
            above.insert(0, lines[line].strip(" #"))
            line -= 1
        if behind or above:
            notes[".".join(path)] = behind[1] if behind else " ".join(above)
    return notes


def _positions(node: Any, path: list[str]) -> Iterator[tuple[list[str], int, int]]:
    """Each key below a node, with the lines of the key and of the end of a plain value."""
    for name, value in node.value if isinstance(node, yaml.MappingNode) else ():
        inner = [*path, name.value]
        first = name.start_mark.line
        block = isinstance(value, yaml.MappingNode) and not value.flow_style
        yield inner, first, first if block else value.end_mark.line
        yield from _positions(value, inner)
