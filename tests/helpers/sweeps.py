"""What Hydra composes for a sweep, as far as the package looks at it."""

from omegaconf import DictConfig, OmegaConf

from deepring.experiment.config_groups import config_folder
from deepring.experiment.sweep_names import naming

_SEARCH = "hydra_plugins.hydra_optuna_sweeper.optuna_sweeper.OptunaSweeper"


def hydra_config(folder, *overrides, launcher=None, params=None, trials=None) -> DictConfig:
    """The config of a sweep; with ``trials`` of a search, which names no job beforehand."""
    kind = "BasicLauncher" if launcher is None else "JoblibLauncher"
    sweeper = {"_target_": "hydra._internal.core_plugins.basic_sweeper.BasicSweeper"}
    if trials is not None:
        sweeper = {"_target_": _SEARCH, "n_trials": trials}
    (override,) = naming(overrides, config_folder())
    excluded = override.partition("=")[2].strip("[]").replace('"', "")
    naming_of = {"kv_sep": "-", "item_sep": "+", "exclude_keys": excluded.split(",")}
    return OmegaConf.create(
        {
            "hydra": {
                "sweep": {
                    "dir": str(folder),
                    "subdir": "${folder_name:${hydra.job.override_dirname}}",
                },
                "launcher": {"_target_": f"hydra.{kind}", **(launcher or {})},
                "sweeper": {**sweeper, "params": params or {}},
                "overrides": {"task": list(overrides)},
                "job": {"config": {"override_dirname": naming_of}, "override_dirname": ""},
            }
        }
    )
