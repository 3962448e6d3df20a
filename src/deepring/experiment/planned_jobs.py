"""The jobs that Hydra is about to launch: the names of their folders, and what each varies."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra import initialize_config_dir
from hydra._internal.config_loader_impl import get_overrides_dirname
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from deepring.experiment.compose import in_our_words
from deepring.experiment.config_groups import config_folder, register_configs
from deepring.experiment.sweep_names import folder_name
from deepring.experiment.sweep_plan import PlannedJob, SweepPlan, at_once, begin_plan

#: How ``conf/hydra`` names the folder of a job; where it is named otherwise, no name is known
#: before the job begins.
_SUBDIR = "${folder_name:${hydra.job.override_dirname}}"


def planned(config: DictConfig) -> SweepPlan:
    """The plan of a sweep, from the config that Hydra composed for all of it."""
    hydra = config.hydra
    launcher: Any = OmegaConf.to_container(hydra.launcher)
    runs_at_once = at_once(launcher)
    sweeper: Any = OmegaConf.to_container(hydra.sweeper)
    if not str(sweeper["_target_"]).endswith(".BasicSweeper"):
        return SweepPlan((), sweeper.get("n_trials") or 0, at_once=runs_at_once)
    texts = [f"{key}={value}" for key, value in (sweeper.get("params") or {}).items()]
    texts += map(str, hydra.overrides.task)
    every = BasicSweeper.split_arguments(OverridesParser.create().parse_overrides(texts), None)[0]
    if OmegaConf.to_container(hydra.sweep, resolve=False)["subdir"] != _SUBDIR:  # type: ignore[index,call-overload]
        return SweepPlan((), len(every), at_once=runs_at_once)
    jobs = {job.folder: job for job in (_job(job, hydra.job.config) for job in every)}
    return SweepPlan(tuple(jobs.values()), at_once=runs_at_once)


def plan_together(sweeps: Sequence[Sequence[str]]) -> None:
    """Write the plans of sweeps that one command runs one after the other, before the first.

    Args:
        sweeps: the overrides of each, without flags.

    Raises:
        ConfigError: a mistake in the overrides.
        FileError: a plan cannot be written.
    """
    register_configs()
    for overrides in sweeps:
        with (
            in_our_words(overrides),
            initialize_config_dir(str(config_folder()), version_base="1.3"),
        ):
            loader = GlobalHydra.instance().config_loader()
            config = loader.load_configuration("train", list(overrides), RunMode.MULTIRUN)
            begin_plan(Path(config.hydra.sweep.dir).resolve(), planned(config))


def _job(overrides: Sequence[str], naming: Any) -> PlannedJob:
    """A job of these overrides, named as Hydra will."""
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    of = naming.override_dirname
    name = get_overrides_dirname(
        parsed, exclude_keys=list(of.exclude_keys), item_sep=of.item_sep, kv_sep=of.kv_sep
    )
    varied = [one for one in parsed if one.key_or_group not in of.exclude_keys]
    return PlannedJob(folder_name(name), {_key(one): _value(one) for one in varied})


def _key(override: Override) -> str:
    return str(override.get_key_element())


def _value(override: Override) -> str:
    return str(override.get_value_element_as_str())
