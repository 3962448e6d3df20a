"""What the folders of a sweep's jobs are called: after what the sweep varies, nothing else."""

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
    """One more override, so that a job's folder is named after the varied keys alone.

    The keys that a file of ``sweep`` varies are part of the name even where ``overrides``
    give them one value. Of a key that is given twice the last value counts, as for Hydra.

    Args:
        overrides: of the sweep, as on the command line; flags among them are ignored.
        configs: the folder of the configs, ``conf/``.

    Raises:
        ConfigError: ``hydra.sweep.dir`` without a value.
    """
    parser = OverridesParser.create()
    swept: dict[str, bool] = {}
    varied = {"seed"}
    for text in overrides:
        if text.startswith("-"):
            continue
        try:
            override = parser.parse_override(text)
        except HydraException:
            continue  # Hydra will say what is wrong
        key = override.get_key_element()
        swept[key] = override.is_sweep_override()
        if key == "hydra.sweep.dir" and not override.value():
            raise ConfigError(f"{text}: expected a folder to keep the sweep in")
        if key == _SWEEPING and not swept[key]:
            varied |= _varied_by(configs / key / f"{override.value()}.yaml")
    fixed = [key for key in swept if not swept[key] and key.lstrip("+~") not in varied]
    keys = ",".join(f'"{key}"' for key in dict.fromkeys(_spellings(fixed)))
    return [f"hydra.job.config.override_dirname.exclude_keys=[{keys}]"]


def _spellings(keys: Sequence[str]) -> Iterator[str]:
    """Each key with and without its + or ~, which Hydra drops in some places."""
    for key in keys:
        yield from (key, key.lstrip("+~"))


def _varied_by(config: Path) -> set[str]:
    """The keys that a config file sweeps; none where there is no such file: Hydra reports it."""
    if not config.is_file():
        return set()
    return set(OmegaConf.select(OmegaConf.load(config), "hydra.sweeper.params", default={}))


def folder_name(varied: str) -> str:
    """The varied keys and values as the name of one folder: no slash, not empty, not too long."""
    name = varied.replace("/", "_") or "run"
    if len(name.encode()) <= 200:
        return name
    return f"{name[:100]}+{hashlib.sha256(varied.encode()).hexdigest()[:12]}"


OmegaConf.register_new_resolver("folder_name", folder_name, replace=True)
