"""Values of ``trainer`` that Lightning would meet, or take as something else, in mid-training."""

import re
from collections.abc import Mapping
from typing import Any

from deepring.checks import at_least, count
from deepring.errors import ConfigError

PRECISIONS = ("32-true", "32", "bf16-mixed", "16-mixed")

_ACCELERATORS = ("auto", "cpu", "gpu", "cuda", "mps", "tpu")

#: Keys that are whole numbers, and the least of each.
_LEAST = {
    "num_nodes": 1,
    "check_val_every_n_epoch": 1,
    "log_every_n_steps": 0,
    "num_sanity_val_steps": -1,
}

#: Keys that are whole numbers of at least 1, or -1 for no limit.
_LIMITS = ("max_epochs", "max_steps")


def check_trainer(values: Any) -> None:
    """Raise ConfigError that names the key of a value that Lightning's trainer cannot work with."""
    if not isinstance(values, Mapping):
        raise ConfigError(
            f"trainer: {'null' if values is None else repr(values)}, expected values by name, such "
            "as max_epochs"
        )
    for key in ("accelerator", "devices", "num_nodes", "precision"):
        if key not in values:
            raise ConfigError(f"trainer.{key}: no value, expected one; give it as trainer.{key}=")
    if str(values["precision"]) not in PRECISIONS:
        raise ConfigError(
            f"trainer.precision: {values['precision']}, expected one of {', '.join(PRECISIONS)}; "
            "sinograms and spectra are computed in float32"
        )
    for key, least in _LEAST.items():
        if (value := values.get(key)) is not None:
            count(f"trainer.{key}", value, least)
    for key in _LIMITS:
        if (value := values.get(key)) not in (None, -1):
            _limit(f"trainer.{key}", value)
    if (clip := values.get("gradient_clip_val")) is not None:
        at_least("trainer.gradient_clip_val", clip, 0)
    if not isinstance(fast := values.get("fast_dev_run", False), bool):
        count("trainer.fast_dev_run", fast, 0)
    _check_time(values.get("max_time"))
    _check_device(values["accelerator"], values["devices"])


def _limit(name: str, value: Any) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise ConfigError(
            f"{name}: {value!r}, expected a whole number of at least 1, or -1 for no limit"
        )


def _check_time(value: Any) -> None:
    if value is None or isinstance(value, Mapping):
        return
    if not re.fullmatch(r"\d+:\d\d:\d\d:\d\d", str(value)):
        raise ConfigError(
            f"trainer.max_time: {value!r}, expected days, hours, minutes and seconds as "
            "'00:12:00:00'"
        )


def _check_device(accelerator: Any, devices: Any) -> None:
    import torch

    if accelerator not in _ACCELERATORS:
        raise ConfigError(
            f"trainer.accelerator: {accelerator!r}, expected one of {', '.join(_ACCELERATORS)}"
        )
    gpus = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if accelerator in ("gpu", "cuda") and not gpus:
        raise ConfigError(
            f"trainer.accelerator: {accelerator!r}, and there is no GPU that torch can use; "
            "expected cpu or auto"
        )
    if devices in ("auto", -1):
        return
    on_gpu = gpus > 0 and accelerator in ("auto", "gpu", "cuda")
    number = devices if not isinstance(devices, list | tuple) else len(devices)
    wrong = not isinstance(number, int) or isinstance(number, bool) or number < 1
    if isinstance(devices, list | tuple):
        wrong = wrong or not on_gpu or not set(devices) <= set(range(gpus))
    if wrong or (on_gpu and number > gpus):
        many = f"a whole number from 1 to {gpus}, -1 for all, or a list of numbers below {gpus}"
        raise ConfigError(
            f"trainer.devices: {devices!r}, expected "
            + (many if on_gpu else "a whole number of at least 1, of processes")
        )
