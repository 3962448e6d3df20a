"""Hydra composes hundreds of configs in the tests; what never changes is read and copied once.

For each config that it composes, Hydra parses the same files again, and copies all that is
registered with `ConfigStore`, though it copies each part once more where it takes it.
"""

import copy
from functools import cache
from pathlib import Path

from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra.core.config_store import ConfigStore
from hydra.plugins.config_source import ConfigResult

_load = FileConfigSource.load_config


def read_files_once() -> None:
    """Keep what a config file holds, as long as the file is the same; share the registered ones."""
    FileConfigSource.load_config = _load_kept
    ConfigStore.__deepcopy__ = lambda store, _: store


def _load_kept(source: FileConfigSource, config_path: str) -> ConfigResult:
    file = Path(source.path, source._normalize_file_name(config_path)).resolve()
    if not file.is_file():
        return _load(source, config_path)  # which says what is missing
    about = file.stat()
    kept = _kept(source.provider, source.path, config_path, about.st_mtime_ns, about.st_ino)
    return copy.deepcopy(kept)


@cache
def _kept(provider: str, path: str, config_path: str, changed: int, number: int) -> ConfigResult:
    return _load(FileConfigSource(provider, path), config_path)
