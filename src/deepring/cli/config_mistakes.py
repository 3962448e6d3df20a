"""What Hydra and OmegaConf say about a mistake in the config, in one line of our own words."""

import re
from typing import Any

#: Types that OmegaConf names in its messages, in plain words.
_TYPES = {"Integer": "a whole number", "Float": "a number", "Boolean": "true or false"}


def config_mistake(error: Exception) -> str | None:
    """The mistake with its key, its value and what was expected; None for any other error.

    Told by the attributes that the two libraries set, so that neither is imported.
    """
    cause = error.__cause__
    if file := getattr(error, "missing_cfg_file", None):
        return _no_such_option(str(file), getattr(error, "options", None) or ())
    if override := getattr(error, "override", None):
        return (
            f"{override}: cannot be read; expected KEY=VALUE, each [ and {{ closed, and quotes "
            "around what has brackets or blanks: 'KEY=[{a: 1}, {b: 2}]'"
        )
    if ambiguous := re.match(r"Ambiguous value for argument '(.+)'", str(error)):
        override = ambiguous[1]
        key, _, values = override.partition("=")
        return (
            f"{override}: several values; expected {key}=[{values}] for a list, or -m for a sweep"
        )
    if cause is None or not hasattr(cause, "full_key"):
        return None
    key = str(cause.full_key)
    if isinstance(cause, AttributeError | KeyError):
        return _no_such_key(key, cause)
    return _wrong_type(key, str(error), str(cause))


def _no_such_option(file: str, options: Any) -> str:
    group, _, option = file.rpartition("/")
    return f"{group}: {option!r}, expected one of {', '.join(options)}"


def _no_such_key(key: str, cause: Any) -> str:
    node = getattr(cause, "parent_node", None)
    keys = [] if node is None else [str(known) for known in node]
    where = key.rpartition(".")[0] or "the config"
    known = f"; {where} has {', '.join(sorted(keys))}" if keys else ""
    return f"{key}: no such key{known}; `deepring train --help` lists the groups"


def _wrong_type(key: str, said: str, cause: str) -> str:
    value = re.search(rf"{re.escape(key)}=(.*)", said)
    kind = re.search(r"could not be converted to (\w+)", cause)
    if kind:
        wanted = _TYPES.get(kind[1], kind[1].lower())
    elif "ListConfig" in cause:
        wanted = "a list, as [1, 2]"
    else:
        wanted = "a value of another type; `deepring train --cfg job` shows those in use"
    return f"{key}: {value[1] if value else 'its value'}, expected {wanted}"
