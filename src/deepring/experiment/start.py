"""The start of a training: weights of an earlier stage, or the state of a run that goes on."""

import logging
from pathlib import Path
from typing import NamedTuple

from torch import Tensor

from deepring.errors import ConfigError, DeepringError
from deepring.experiment.config import Config
from deepring.methods.checkpoint_file import read_checkpoint
from deepring.methods.network import NetworkMethod, class_path
from deepring.methods.network_file import TrainedNetwork, load_stage, weights_of
from deepring.paper.flat import flatten
from deepring.training.module import PlaceModule

log = logging.getLogger(__name__)


class TrainedBefore(NamedTuple):
    """What earlier trainings have done for a network."""

    datasets: tuple[str, ...]
    """Names of the datasets that its weights have seen."""
    parts: tuple[str, ...]
    """The parts whose weights are trained, all of them."""


NOTHING = TrainedBefore((), ())


def start_from(method: NetworkMethod, checkpoint: str) -> TrainedBefore:
    """Give the network the weights of an earlier stage that fit, and log which begin anew.

    Of the checkpoint's parts those count that were trained. A weight fits where name, type and
    shape are the network's.

    Raises ConfigError for a file that is no checkpoint, a checkpoint of another method, and one
    of which nothing but biases fits. The network is changed only if none is raised.
    """
    try:
        network = load_stage(checkpoint, type(method))
    except DeepringError as error:
        raise ConfigError(f"start_from: {error}") from error
    _expect_method(method, network.method, checkpoint)
    own = weights_of(method)
    trained = {
        name: weight
        for name, weight in weights_of(network.method).items()
        if _part_of(name) not in network.untrained
    }
    taken = {name: weight for name, weight in trained.items() if _fits(weight, own.get(name))}
    learned = [name for name, _ in method.named_parameters() if name in taken]
    if not any(taken[name].dim() > 1 for name in learned):  # biases alone fit by their length
        raise ConfigError(
            f"start_from: {checkpoint} holds no matrix of weights that fits: settings differ in "
            f"{', '.join(_differing(network.method, method)) or 'nothing'}; expected a checkpoint "
            "with layers of this size"
        )
    method.load_state_dict({**own, **taken})
    _log_taken(checkpoint, method, taken, learned, trained)
    if changes := _differing(network.method, method):
        log.info("start_from: settings that differ from its own: %s", ", ".join(changes))
    anew = {_part_of(name) for name in own if name not in taken}
    complete = tuple(part for part in method.parts if part not in anew)
    return TrainedBefore(tuple(network.trained_on.split("+")), complete)


def resumed_from(resume: str, method: NetworkMethod) -> tuple[TrainedNetwork, TrainedBefore]:
    """The network of a run that goes on, and what its training had done by then.

    Raises ConfigError for anything but a run's checkpoint.
    """
    if not resume.endswith(".ckpt"):
        raise ConfigError(
            f"resume: {resume}, expected the .ckpt of a run, which holds the state of the "
            "training and not the network alone"
        )
    network = load_stage(resume, type(method))
    parts = tuple(part for part in network.method.parts if part not in network.untrained)
    return network, TrainedBefore(tuple(network.trained_on.split("+")), parts)


def check_resume(resume: str, network: TrainedNetwork, module: PlaceModule) -> None:
    """Raise ConfigError unless ``resume`` is a checkpoint of the same network, parts and loss."""
    saved, current = network.method.settings, module.method.settings
    parts = read_checkpoint(Path(resume))["hyper_parameters"].get("trained_parts")
    before = {"method": saved.label, **flatten(saved.to_dict()), "loss": network.loss}
    now = {"method": current.label, **flatten(current.to_dict())}
    now["loss"] = type(module.loss).__name__
    before["trained_parts"], now["trained_parts"] = parts, module.parts
    differing = [name for name in {**now, **before} if now.get(name) != before.get(name)]
    if "method" in differing:
        differing = ["method"]
    if differing:
        raise ConfigError(
            f"resume: {resume} was trained with other {', '.join(differing)}: "
            + "; ".join(f"{name} {before.get(name)}, now {now.get(name)}" for name in differing)
            + "; give the same overrides as for that run"
        )


def expect_no_start(cfg: Config) -> None:
    """Raise ConfigError for weights to begin with where nothing is trained."""
    if cfg.start_from is not None:
        raise ConfigError(
            f"start_from: {cfg.start_from}, expected null where nothing is trained; "
            "checkpoint=FILE is the network to evaluate"
        )


def _expect_method(method: NetworkMethod, other: NetworkMethod, checkpoint: str) -> None:
    if type(other) is not type(method):
        raise ConfigError(
            f"start_from: {checkpoint} holds a network of {other.settings.label} "
            f"({class_path(other)}), but method is {method.settings.label}; expected a checkpoint "
            "of the method that is trained"
        )


def _differing(before: NetworkMethod, now: NetworkMethod) -> list[str]:
    """The settings that differ, with both values."""
    one, other = (flatten(network.settings.to_dict()) for network in (before, now))
    names = [name for name in {**other, **one} if one.get(name) != other.get(name)]
    return [f"{name} {one.get(name)}, now {other.get(name)}" for name in names]


def _log_taken(
    checkpoint: str,
    method: NetworkMethod,
    taken: dict[str, Tensor],
    learned: list[str],
    trained: dict[str, Tensor],
) -> None:
    weights = dict(method.named_parameters())
    anew = _modules([name for name in weights if name not in taken], learned)
    log.info(
        "start_from %s: %d of %d weights are taken; %s",
        checkpoint,
        sum(weights[name].numel() for name in learned),
        sum(weight.numel() for weight in weights.values()),
        f"{', '.join(anew)} begin anew" if anew else "none begin anew",
    )
    if left := _modules([name for name in trained if name not in taken], learned):
        log.warning("start_from %s: its %s do not fit, and are left", checkpoint, ", ".join(left))


def _modules(names: list[str], others: list[str]) -> list[str]:
    """The largest modules that the named weights fill, which hold none of the others.

    >>> _modules(["a.b.weight", "a.b.bias", "c.d.weight", "c.weight"], ["a.weight"])
    ['a.b', 'c']
    """
    found: dict[str, None] = {}
    for name in names:
        steps = name.split(".")
        prefixes = (".".join(steps[:k]) for k in range(1, len(steps) + 1))
        found[next(p for p in prefixes if not _within(p, others))] = None
    return list(found)


def _within(prefix: str, names: list[str]) -> bool:
    return any(name == prefix or name.startswith(prefix + ".") for name in names)


def _part_of(name: str) -> str:
    return name.partition(".")[0]


def _fits(weight: Tensor, own: Tensor | None) -> bool:
    return own is not None and (weight.dtype, weight.shape) == (own.dtype, own.shape)
