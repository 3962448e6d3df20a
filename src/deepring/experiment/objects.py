"""Objects of the config's nodes: a wrong value is refused by its key before anything is made."""

import collections.abc
import inspect
import math
import typing
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, get_type_hints

from hydra.errors import InstantiationException
from hydra.utils import get_object, instantiate

from deepring.checks import at_least, count, positive
from deepring.errors import ConfigError, DeepringError
from deepring.experiment.plain_types import fits, in_words
from deepring.text import shown

#: Values of optimizers and schedules that torch takes whatever they are.
_RANGES: dict[str, Callable[[str, Any], Any]] = {
    "lr": partial(at_least, least=0),
    "weight_decay": partial(at_least, least=0),
    "momentum": partial(at_least, least=0),
    "gamma": positive,
    "step_size": count,
}


def make(node: Any, key: str, *args: Any, **kwargs: Any) -> Any:
    """Hydra's instantiate, after a check of the node's values.

    Args:
        node: of the config; ``_target_`` names what is made.
        key: of the node, for messages.
        args: before the node's values.
        kwargs: set here, and not by the node.

    Raises:
        ConfigError: the node is none, its target cannot be imported, or a value is unknown, of
            another type, or refused by the target. The message names the key of the value.
    """
    target = target_of(node, key)
    values = {name: value for name, value in node.items() if not name.startswith("_")}
    for name in values:
        if name in kwargs:
            raise ConfigError(f"{key}.{name}: is set by deepring itself; leave it out")
    parameters = _parameters(target)
    _check_names(values, parameters, key, target, len(args), kwargs)
    _check_values(values, target, key)
    try:
        return instantiate(node, *args, **kwargs)
    except InstantiationException as error:
        cause = error.__cause__
        if isinstance(cause, DeepringError):
            raise _with_key(cause, key, values) from None
        raise ConfigError(_refused(node, key, values, args, kwargs, parameters)) from error


def _with_key(error: DeepringError, key: str, values: Mapping[str, Any]) -> DeepringError:
    """The error with the config's key where it names an argument."""
    named = str(error).partition(":")[0] in values
    return ConfigError(f"{key}.{error}") if named else error


def target_of(node: Any, key: str) -> Callable[..., Any]:
    """What a node's ``_target_`` names. Raises ConfigError if it cannot be imported."""
    if not isinstance(node, Mapping):
        raise ConfigError(f"{key}: {_shown(node)}, expected values by name, and _target_ a class")
    path = node.get("_target_")
    try:
        target = get_object(str(path))
    except (ImportError, ValueError, AttributeError):
        target = None
    if not callable(target):
        raise ConfigError(
            f"{key}._target_: {path!r} cannot be imported; expected the dotted path of a class, "
            f"such as {_EXAMPLES.get(key.partition('.')[0], _EXAMPLE)}; a module of your own has "
            "to be on the Python path"
        )
    return target


_EXAMPLE = "deepring.methods.deepring.DeepRing"
_EXAMPLES = {
    "optimizer": "torch.optim.Adam",
    "scheduler": "torch.optim.lr_scheduler.StepLR",
    "trainer": "lightning.Trainer",
    "loss": "deepring.training.episodes.OneShotCrossEntropy",
    "sampling": "deepring.training.episodes.EpisodeScheme",
    "callbacks": "lightning.pytorch.callbacks.EarlyStopping",
    "logger": "lightning.pytorch.loggers.CSVLogger",
    "methods": "deepring.methods.ring.Ring",
}


def class_of(node: Any, key: str = "method") -> type[Any]:
    """The class that a node names. Raises ConfigError if it cannot be imported, or is no class."""
    target = target_of(node, key)
    if not isinstance(target, type):
        raise ConfigError(f"{key}._target_: {node['_target_']!r} is no class, expected one")
    return target


def _parameters(target: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    """The target's parameters by name; none where Python cannot tell."""
    try:
        return inspect.signature(target).parameters
    except (TypeError, ValueError):
        return {}


def _check_names(
    values: Mapping[str, Any],
    parameters: Mapping[str, inspect.Parameter],
    key: str,
    target: Any,
    before: int,
    kwargs: Mapping[str, Any],
) -> None:
    kinds = {parameter.kind for parameter in parameters.values()}
    if not parameters or inspect.Parameter.VAR_KEYWORD in kinds:
        return
    named = [p for p in parameters.values() if p.kind is not inspect.Parameter.VAR_POSITIONAL]
    named = named[before:]
    known = ", ".join(p.name for p in named if p.name not in kwargs)
    for name in values:
        if name not in {p.name for p in named}:
            raise ConfigError(f"{key}.{name}: unknown to {_name(target)}, expected one of {known}")
    lacking = [
        p.name
        for p in named
        if p.default is inspect.Parameter.empty and p.name not in {*values, *kwargs}
    ]
    if lacking:
        raise ConfigError(
            f"{key}.{lacking[0]}: no value, {_name(target)} expected one; give it as "
            f"+{key}.{lacking[0]}=VALUE"
        )


def _check_values(values: Mapping[str, Any], target: Any, key: str) -> None:
    hints = _hints(target)
    for name, value in values.items():
        where = f"{key}.{name}"
        _check_finite(where, value)
        hint = hints.get(name, Any)
        if not fits(hint, value):
            raise ConfigError(f"{where}: {_shown(value)}, expected {in_words(hint)}")
        if name in _RANGES and value is not None and not isinstance(value, Mapping):
            _RANGES[name](where, value)


def _hints(target: Any) -> dict[str, Any]:
    """The type hints of a target's arguments, without those that cannot be resolved here."""
    function = inspect.unwrap(target.__init__ if inspect.isclass(target) else target)
    names = {**vars(typing), **vars(collections.abc), **getattr(function, "__globals__", {})}
    hints = {}
    for name, hint in getattr(function, "__annotations__", {}).items():
        with suppress(Exception):  # of any kind, since a hint may be any text
            hints[name] = get_type_hints(_Hinted({name: hint}), names)[name]
    return hints


class _Hinted:
    """Something with annotations, for `get_type_hints`."""

    def __init__(self, annotations: dict[str, Any]) -> None:
        self.__annotations__ = annotations


def _check_finite(where: str, value: Any) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{where}: {value}, expected a finite number")
    inner = value.items() if isinstance(value, Mapping) else ()
    for name, each in inner or enumerate(value if isinstance(value, list | tuple) else ()):
        _check_finite(f"{where}.{name}", each)


def _refused(
    node: Mapping[str, Any],
    key: str,
    values: Mapping[str, Any],
    args: Any,
    kwargs: Mapping[str, Any],
    parameters: Mapping[str, inspect.Parameter],
) -> str:
    """Which value the target refuses: the one without which it takes the others."""
    target = node["_target_"]
    for name, value in values.items():
        without = {other: each for other, each in node.items() if other != name}
        try:
            instantiate(without, *args, **kwargs)
        except InstantiationException:
            continue
        default = parameters[name].default if name in parameters else None
        given = f"; its default is {_shown(default)}" if _is_value(default) else ""
        return f"{key}.{name}: {_shown(value)}, expected a value that {target} takes{given}"
    given = ", ".join(f"{name} {_shown(value)}" for name, value in values.items())
    return f"{key}: {target} takes no such values together: {given}; expected others"


def _is_value(default: Any) -> bool:
    return default is None or isinstance(default, bool | int | float | str | list | tuple)


def _name(target: Any) -> str:
    return f"{getattr(target, '__module__', '')}.{getattr(target, '__qualname__', target)}"


def _shown(value: Any) -> str:
    if value is None:
        return "null"
    return shown(value, 80)
