"""Names of the folders of a sweep's jobs, which state only what the sweep varies."""

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import OmegaConf

from deepring.errors import ConfigError

#: The group whose files say what a sweep varies.
_SWEEPING = "sweep"


def naming(overrides: Sequence[str], configs: Path) -> list[str]:
    """A further override, so that a job's folder is named after only the varied keys.

    Keys that a file of ``sweep`` varies are part of the name even if ``overrides`` give them one
    value. If a key occurs twice, the last value counts, as for Hydra.

    Args:
        overrides: of the sweep, as on the command line; flags among them are ignored.
        configs: the folder of the configs, ``conf/``.

    Raises:
        ConfigError: ``hydra.sweep.dir`` without a value.
    """
    parser = OverridesParser.create()
    is_sweep: dict[str, bool] = {}
    sweep_keys = {"seed"}
    for text in overrides:
        if text.startswith("-"):
            continue
        try:
            override = parser.parse_override(text)
        except HydraException:
            continue  # Hydra will say what is wrong
        key = override.get_key_element()
        is_sweep[key] = override.is_sweep_override()
        if key == "hydra.sweep.dir" and not override.value():
            raise ConfigError(f"{text}: no value, expected the folder of the sweep")
        if key == _SWEEPING and not is_sweep[key]:
            sweep_keys |= set(swept(override.value(), configs))
    fixed = [key for key in is_sweep if not is_sweep[key] and key.lstrip("+~") not in sweep_keys]
    keys = ",".join(f'"{key}"' for key in dict.fromkeys(_spellings(fixed)))
    return [f"hydra.job.config.override_dirname.exclude_keys=[{keys}]"]


def _spellings(keys: Sequence[str]) -> Iterator[str]:
    """Each key with and without its + or ~, which Hydra drops in some places."""
    for key in keys:
        yield from (key, key.lstrip("+~"))


def swept(sweep: object, configs: Path) -> dict[str, str]:
    """What a sweep varies: keys to values as text. None if there is no such file, as Hydra says."""
    config = configs / _SWEEPING / f"{sweep}.yaml"
    if not config.is_file():
        return {}
    values = OmegaConf.select(OmegaConf.load(config), "hydra.sweeper.params", default={})
    return {str(key): str(value) for key, value in values.items()}


def folder_name(overrides: str) -> str:
    """Varied keys and values as a folder's name, without slashes, not empty and not too long."""
    name = overrides.replace("/", "_") or "run"
    if len(name.encode()) <= 200:
        return name
    return f"{name[:100]}+{hashlib.sha256(overrides.encode()).hexdigest()[:12]}"


OmegaConf.register_new_resolver("folder_name", folder_name, replace=True)
