"""What a key of the config holds, by the types of `deepring.experiment.config.Config`."""

from dataclasses import is_dataclass
from typing import Any, get_args, get_origin, get_type_hints

from deepring.experiment.plain_types import in_words, without_none


def kind_at(key: str) -> Any:
    """The type of the values at a dotted key, such as 'data.spacing.train'; None if it has none."""
    from deepring.experiment.config import Config

    kind: Any = Config
    for part in key.replace("[", ".").split("."):
        kind = without_none(kind)
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
    kind = kind_at(key)
    return _OTHER if kind is None else in_words(kind) or _OTHER


def is_text(key: str) -> bool:
    """Whether the values at a key are text, such as the path of a file."""
    return without_none(kind_at(key)) is str


_OTHER = "a value of another type; `deepring train --cfg job` shows those in use"
