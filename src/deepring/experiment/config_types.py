"""What a key of the config holds, by the types of `deepring.experiment.config.Config`."""

from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}

_UNKNOWN = "a value of another type; `deepring train --cfg job` shows those in use"


def kind_at(key: str) -> Any:
    """The type of the values at a dotted key, such as 'data.spacing.train'; None if it has none."""
    from deepring.experiment.config import Config

    kind: Any = Config
    for part in key.replace("[", ".").split("."):
        kind = _without_none(kind)
        if is_dataclass(kind):
            kind = get_type_hints(kind).get(part)
        elif get_origin(kind) in (dict, list):
            kind = get_args(kind)[-1]
        else:
            return None
    return None if kind is Any else kind


def expected_at(key: str) -> str:
    """What to expect at a key, in words.

    >>> expected_at("data.spacing.train"), expected_at("checkpoint"), expected_at("data.spacing")
    ('a number', 'text or null', 'values by name: database, query, train')
    """
    return _words(kind_at(key))


def is_text(key: str) -> bool:
    """Whether the values at a key are text, such as the path of a file."""
    return _without_none(kind_at(key)) is str


def _words(kind: Any) -> str:
    inner = _without_none(kind)
    if inner is not kind:
        return f"{_words(inner)} or null"
    if kind in _WORDS:
        return _WORDS[kind]
    if is_dataclass(kind):
        return f"values by name: {', '.join(field.name for field in fields(kind))}"
    if get_origin(kind) is dict:
        return "values by name"
    if get_origin(kind) is list:
        return "a list, as [a, b]" if get_args(kind)[0] is str else "a list, as [1, 2]"
    return _UNKNOWN


def _without_none(kind: Any) -> Any:
    if get_origin(kind) not in (Union, UnionType):
        return kind
    others = [other for other in get_args(kind) if other is not NoneType]
    return others[0] if len(others) == 1 else kind
