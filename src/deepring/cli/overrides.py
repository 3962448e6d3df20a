"""The arguments of a command that composes a config, held against Hydra's grammar beforehand."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from deepring.checks import one_of
from deepring.errors import ConfigError
from deepring.experiment.config_groups import config_folder, group_options
from deepring.experiment.config_types import expected_at, is_text, kind_at

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override

#: Flags of Hydra and the values that they take: () for none, None for any.
_FLAGS: dict[str, tuple[str, ...] | None] = {
    "--multirun": (),
    "--cfg": ("job", "hydra", "all"),
    "--info": ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath"),
    "--package": None,
    "--config-dir": None,
    "--run": (),
    "--resolve": (),
    "--hydra-help": (),
}

_SHORT = {
    **{"-m": "--multirun", "-c": "--cfg", "-i": "--info", "-p": "--package"},
    **{"-cd": "--config-dir", "-r": "--run"},
}

#: Those that print something instead of running jobs.
_MODES = ("--cfg", "--info", "--package", "--run", "--resolve")

#: What has a meaning in Hydra's grammar, so that a value with it needs quotes.
_SPECIAL = "= [ ] { } ( ) # ; ~ ! & ' \" or letters beyond ASCII"


def is_sweep(arguments: Sequence[str]) -> bool:
    """Whether the arguments ask for a sweep. Raises ConfigError for a further mode."""
    flags = [_long(argument.partition("=")[0]) for argument in arguments]
    multirun = "--multirun" in flags
    modes = [flag for flag in flags if flag in _MODES]
    if multirun and modes:
        raise ConfigError(
            f"-m: together with {modes[0]}, which prints one config; expected only one of the two"
        )
    return multirun


def checked(arguments: Sequence[str]) -> list[str]:
    """The arguments as Hydra takes them, flags first and each with its value.

    Whether the config has the keys is told when it is composed. Raises ConfigError for an argument
    that Hydra cannot read, or would read otherwise than it is written: the message names it, and
    says how to write it.
    """
    sweep = is_sweep(arguments)
    flags, overrides = _split(arguments)
    for text in overrides:
        _check(text, sweep)
    return [*flags, *overrides]


def value_of(arguments: Sequence[str], key: str) -> str | None:
    """The last text that the arguments give a key, without quotes; None if there is none."""
    from hydra.core.override_parser.overrides_parser import OverridesParser

    value = None
    for text in arguments:
        if text.startswith(f"{key}="):
            value = OverridesParser.create().parse_override(text).value()
    return None if value is None else str(value)


def choices_of(text: str) -> list[str]:
    """What an override gives its key, one after the other in a sweep; lists are taken apart.

    >>> choices_of("train=nclt,[nclt,mulran]")
    ['nclt', 'nclt', 'mulran']
    """
    from hydra.core.override_parser.overrides_parser import OverridesParser

    override = OverridesParser.create().parse_override(text)
    swept = override.is_sweep_override()
    values = list(override.sweep_string_iterator()) if swept else [override.value()]
    return [part for value in values for part in str(value).strip("[]").split(",")]


def quoted(key: str, value: str) -> str:
    """``KEY="VALUE"``, which Hydra reads as this very text."""
    escaped = value.replace("${", "\\${")
    parts = escaped.split('"')  # backslashes count only before a quote
    whole = '\\"'.join(p + "\\" * _trailing(p) for p in parts)
    return f'{key}="{whole}"'


def _trailing(text: str) -> int:
    return len(text) - len(text.rstrip("\\"))


def _long(flag: str) -> str:
    return _SHORT.get(flag, flag)


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Flags, each with its value, and overrides. Raises ConfigError for a wrong flag."""
    flags: list[str] = []
    overrides: list[str] = []
    rest = list(arguments)
    while rest:
        text = rest.pop(0)
        if not text.startswith("-"):
            overrides.append(text)
            continue
        written, equals, value = text.partition("=")
        flag = _long(written)
        if flag not in _FLAGS:
            raise ConfigError(
                f"{text}: no such flag, expected KEY=VALUE or one of {', '.join(_FLAGS)}"
            )
        if not equals and _FLAGS[flag] != () and rest and _may_be_value(flag, rest[0]):
            equals, value = "=", rest.pop(0)
        flags.append(_flag(written, equals, value))
    return flags, overrides


def _may_be_value(flag: str, text: str) -> bool:
    choices = _FLAGS[flag]
    if text.startswith("-"):
        return False
    return text in (choices or ()) if flag == "--info" else choices is None or "=" not in text


def _flag(written: str, equals: str, value: str) -> str:
    """A flag with its value. Raises ConfigError if it takes no value, or another one."""
    flag = _long(written)
    choices = _FLAGS[flag]
    if choices == ():
        if equals:
            raise ConfigError(f"{written}: {value!r}, expected no value; give {written} alone")
        return flag
    if flag == "--info" and not equals:
        value = "all"
    if choices is not None:
        one_of(written, value, choices)
    elif not value:
        raise ConfigError(f"{written}: no value, expected one behind it")
    return f"{flag}={value}"


def _check(text: str, sweep: bool) -> None:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    key, equals, value = text.partition("=")
    if not key.lstrip("+~"):
        raise ConfigError(f"{text!r}: no key, expected KEY=VALUE")
    if not equals and not key.startswith("~"):
        raise ConfigError(
            f"{text}: no value, expected KEY=VALUE; a value with blanks needs two pairs of quotes: "
            + _advice("KEY", "a b")
        )
    if equals and not value:
        raise ConfigError(f"{text}: no value, {_expected(key)}")
    try:
        override = OverridesParser.create().parse_override(text)
        override.value()
    except (HydraException, ValueError):
        raise ConfigError(_unreadable(text, key, value)) from None
    if override.is_sweep_override() and not sweep:
        raise ConfigError(_ambiguous(text, key, value))
    if not sweep:
        _check_value(text, override)


def _unreadable(text: str, key: str, value: str) -> str:
    if not _readable(quoted(key, "a")):
        return (
            f"{text}: cannot be read, expected KEY=VALUE with a KEY of names and dots, such as "
            "data.root"
        )
    if value[0] in "[{" and value[-1] in "]}":
        return (
            f"{text}: cannot be read as a list or as values by name, expected each [ and {{ "
            f"closed, as in {shlex.quote(key + '=[{a: 1}, {b: 2}]')}; or, for a text, "
            f"{_advice(key, value)}"
        )
    return (
        f"{text}: cannot be read; a value with one of {_SPECIAL} needs two pairs of quotes: "
        f"{_advice(key, value)}"
    )


def _ambiguous(text: str, key: str, value: str) -> str:
    kind = kind_at(key)
    ways = ["-m for a sweep over them"]
    if "(" not in value and kind not in (bool, int, float):
        if not is_text(key):
            ways.insert(0, f"{key}=[{value}] for a list")
        if key not in group_options(config_folder()):
            ways.append(f"{_advice(key, value)} for one text")
    return f"{text}: several values, expected one, or {', or '.join(ways)}"


def _check_value(text: str, override: "Override") -> None:
    key, value = override.key_or_group, override.value()
    if override.is_delete():
        return
    if key in group_options(config_folder()):
        several = value if isinstance(value, list) else [value]
        if not several or not all(isinstance(option, str) for option in several):
            raise ConfigError(
                f"{text}: expected the name of an option of {key}; ~{key} chooses none"
            )
    given = text.partition("=")[2]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if number and is_text(key) and str(value) != given:
        raise ConfigError(
            f"{text}: would be read as the number {value}, expected text in two pairs of quotes: "
            + _advice(key, given)
        )


def _expected(key: str) -> str:
    if is_text(key):
        return f"expected text; {_advice(key, '')} gives an empty one, {key}=null none"
    return "expected KEY=VALUE" if kind_at(key) is None else f"expected {expected_at(key)}"


def _advice(key: str, value: str) -> str:
    """How to write the override in a shell."""
    home = value.startswith("~/")  # which the shell leaves as it is behind an equals sign
    return shlex.quote(quoted(key, str(Path(value).expanduser()) if home else value))


def _readable(text: str) -> bool:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    try:
        OverridesParser.create().parse_override(text)
    except HydraException:
        return False
    return True
