"""What Hydra and OmegaConf say about a mistake in the config, in one line of our own words."""

import re
from collections.abc import Sequence
from typing import Any

from deepring.experiment.config_types import expected_at

#: Messages of Hydra, and ours in their place.
_HYDRA = (
    (
        r"Could not append to config\. An item is already at '(.+?)'",
        r"+\1: the config has this key, expected \1=VALUE without the +",
    ),
    (
        r"Could not delete from config\. '(.+?)' does not exist",
        r"~\1: no such key; leave it out",
    ),
    (
        r"Could not delete from config\. The value of '(.+?)' is (.*?) and not (.*?)\.",
        r"~\1=\3: its value is \2, expected ~\1",
    ),
    (
        r"Could not delete '(.+?)'\. No match in the defaults list",
        r"~\1: not chosen; leave it out",
    ),
    (
        r"Could not override '(.*?)'\.[\s\S]*No match in the defaults list",
        r"\1: no option of this group is chosen, expected a group of `deepring train --help`; "
        r"+\1=OPTION adds one",
    ),
    (
        r"Could not add '(.+?)'\. '(.+?)' is already in the defaults list",
        r"+\1: one is chosen already, expected \2=OPTION without the +",
    ),
    (
        r"Multiple values for ([^\s.]+)\.",
        r"\1: given several times, expected one option; leave the others out",
    ),
    (
        r"(\S+) appears more than once in the final defaults list",
        r"\1: given several times, expected one option; leave the others out",
    ),
    (
        r"Override (\S+?)(?:=.*)? looks like a config group override, but config group '(.+?)' .*",
        r"\1: no such group, expected one of `deepring train --help`",
    ),
    (
        r"force-add of config groups is not supported: '\++(.+?)=(.*)'",
        r"++\1: a group, expected \1=\2 without ++",
    ),
    (
        r"Additional config directory '(.+?)' not found[\s\S]*",
        r"--config-dir: \1, expected a folder of configs",
    ),
    (
        r"hydra\.searchpath must be a list of strings\. Got: (.*)",
        r"hydra.searchpath: \1, expected a list of folders",
    ),
)

#: Longest value that is repeated in a message, in characters.
_LONGEST = 80


def config_mistake(error: Exception, overrides: Sequence[str] = ()) -> str | None:
    """The mistake with its key, its value and what was expected; None for any other error.

    Told by the attributes and texts that the two libraries set.

    Args:
        error: raised while a config is composed or resolved.
        overrides: as given on the command line, to name one where the error names none.
    """
    if not _of_config(error):
        return None
    if mark := getattr(error, "problem_mark", None):  # of PyYAML
        return f"{mark.name}, line {mark.line + 1}: is no YAML, expected a config; correct it"
    if isinstance(error, UnicodeDecodeError):
        return "config: one of its files is no text, expected YAML in UTF-8; see --config-dir"
    if (file := getattr(error, "missing_cfg_file", None)) is not None:
        return _no_such_option(str(file), getattr(error, "options", None) or ())
    cause = error if hasattr(error, "full_key") else error.__cause__ or error.__context__
    if cause is not None and getattr(cause, "full_key", None):
        return _of_key(cause, str(error), overrides)
    for theirs, ours in _HYDRA:
        if match := re.search(theirs, str(error)):
            return match.expand(ours)
    given = f" with {', '.join(overrides)}" if overrides else ""
    return (
        f"config: cannot be composed{given}, expected keys and options of `deepring train --help`; "
        "leave them out one by one"
    )


def _of_config(error: Exception) -> bool:
    """Whether Hydra, OmegaConf or PyYAML raised it: by its class, or by the module that raised it.

    Both also raise ValueErrors and AssertionErrors.
    """
    modules = {cls.__module__.partition(".")[0] for cls in type(error).__mro__}
    trace, name = error.__traceback__, ""
    while trace is not None:
        inner = str(trace.tb_frame.f_globals.get("__name__", ""))
        name, trace = (name if inner == "codecs" else inner), trace.tb_next
    if isinstance(error, ValueError | AssertionError):
        modules.add(name.partition(".")[0])
    return bool(modules & {"hydra", "omegaconf", "yaml"})


def _no_such_option(file: str, options: Any) -> str:
    from deepring.experiment.config_groups import config_folder, group_options

    group, _, option = file.rpartition("/")
    options = options or group_options(config_folder()).get(group, ())
    return f"{group}: {option!r}, expected one of {', '.join(options)}"


def _of_key(cause: Any, said: str, overrides: Sequence[str]) -> str:
    """The mistake at one key of the config."""
    key, text = str(cause.full_key), str(cause)
    kinds = {cls.__name__ for cls in type(cause).__mro__}
    if "InterpolationResolutionError" in kinds or "GrammarParseError" in kinds:
        return _unresolved(key, text, overrides)
    if isinstance(cause, AttributeError | KeyError):
        return _no_such_key(key, cause)
    if "MissingMandatoryValue" in kinds:
        return f"{key}: no value, expected {expected_at(key)}; give it as {key}=VALUE"
    return _wrong_type(key, said, text)


def _unresolved(key: str, text: str, overrides: Sequence[str]) -> str:
    missing = re.search(r"Interpolation key '(.+?)' not found", text)
    variable = re.search(r"Environment variable '(.+?)' not found", text)
    resolver = re.search(r"Unsupported interpolation type (\S+)", text)
    if missing:
        reason = f"${{{missing[1]}}} refers to a key that the config lacks, expected another"
    elif variable:
        reason = (
            f"${{oc.env:{variable[1]}}} refers to a variable that is not set; set it, or give "
            f"${{oc.env:{variable[1]},DEFAULT}}"
        )
    elif resolver:
        reason = (
            f"${{{resolver[1]}:...}} names no resolver, expected ${{KEY}} or ${{oc.env:VARIABLE}}"
        )
    elif "Recursive" in text:
        reason = "its value refers to itself, expected another key in ${KEY}"
    else:
        reason = "its ${...} cannot be resolved, expected ${KEY} or ${oc.env:VARIABLE}"
    given = [o for o in overrides if "${" in o and o.partition("=")[0].lstrip("+") != key]
    return f"{key}: {reason}" + (f"; see {', '.join(given)}" if given else "")


def _no_such_key(key: str, cause: Any) -> str:
    if "/" in key:
        return f"{key}: no such group, expected one of `deepring train --help`"
    node = getattr(cause, "parent_node", None)
    keys = [] if node is None else [str(known) for known in node]
    where = key.rpartition(".")[0] or "the config"
    known = f"; {where} has {', '.join(sorted(keys))}" if keys else ""
    return f"{key}: no such key{known}; `deepring train --help` lists the groups"


def _wrong_type(key: str, said: str, cause: str) -> str:
    found = re.search(rf"{re.escape(key)}=(.*)", said) or re.search(r"Value '(.*?)' of type", cause)
    value = found[1] if found else "null" if "not Optional" in cause else "its value"
    shown = value if len(value) <= _LONGEST else f"{value[: _LONGEST - 3]}..."
    return f"{key}: {shown}, expected {expected_at(key)}"
