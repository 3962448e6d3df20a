"""Settings as frozen dataclasses of plain values: read from a config or a file, checked by type."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from types import NoneType, UnionType
from typing import Any, Literal, Self, Union, get_args, get_origin, get_type_hints

from deepring.errors import ConfigError
from deepring.methods.plain_values import plain


class SettingsGroup:
    """Base of frozen dataclasses of plain values, and of further groups of them.

    Sequences become tuples, those within dicts lists, so that equal settings compare equal
    wherever they come from.
    """

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if isinstance(value, list):
                object.__setattr__(self, name, tuple(value))
            elif isinstance(value, dict):
                object.__setattr__(self, name, plain(value))

    def to_dict(self) -> dict[str, Any]:
        """Plain dict of dicts, lists, strings and numbers, as `from_dict` takes it."""
        return {f.name: plain(getattr(self, f.name), _leaf) for f in fields(self)}  # type: ignore[arg-type]

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], key: str | None = None) -> Self:
        """The settings of plain values; what is left out takes its default.

        Args:
            values: by name; those of a group are a dict.
            key: what the settings are called in messages, such as the config's 'method'.

        Raises:
            ConfigError: a name that is no setting, or a value of another type. The message names
                it as ``key.name``.
        """
        key = cls.title() if key is None else key
        hints = get_type_hints(cls)
        names = [f.name for f in fields(cls)]  # type: ignore[arg-type]
        return cls(**read_values(key, values, {name: hints[name] for name in names}))

    @classmethod
    def title(cls) -> str:
        """What the settings are called in messages where nothing else is said."""
        return "settings"


def read_values(key: str, values: Any, hints: Mapping[str, Any]) -> dict[str, Any]:
    """The values, where each has a type hint and fits it; groups of settings are made of dicts.

    >>> read_values("encoder", {"stem": 2}, {"stem": int, "norm": str})
    {'stem': 2}
    >>> read_values("encoder", {"steam": 2}, {"stem": int, "norm": str})
    Traceback (most recent call last):
    deepring.errors.ConfigError: encoder.steam: unknown, expected one of stem, norm
    """
    if not isinstance(values, Mapping):
        raise ConfigError(f"{key}: {values!r}, expected settings by name: {', '.join(hints)}")
    for name in values:
        if name not in hints:
            raise ConfigError(f"{key}.{name}: unknown, expected one of {', '.join(hints)}")
    return {name: _read(f"{key}.{name}", value, hints[name]) for name, value in values.items()}


def _read(key: str, value: Any, hint: Any) -> Any:
    if isinstance(hint, type) and issubclass(hint, SettingsGroup):
        return value if isinstance(value, hint) else hint.from_dict(value, key)
    if not _fits(value, hint):
        raise ConfigError(f"{key}: {value!r}, expected {_in_words(hint)}")
    return value


def _fits(value: Any, hint: Any) -> bool:
    """Whether a plain value is of the hinted type; a whole number is a number, a bool is none."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(_fits(value, option) for option in arguments)
    if origin is Literal:
        return value in arguments
    if origin in (Sequence, list, tuple):
        elements = [argument for argument in arguments if argument is not ...]
        if origin is tuple and ... not in arguments:
            of_length = isinstance(value, list | tuple) and len(value) == len(elements)
            return of_length and all(map(_fits, value, elements))
        return isinstance(value, list | tuple) and all(_fits(v, elements[0]) for v in value)
    if hint in (int, float):
        kinds = int if hint is int else (int, float)
        return isinstance(value, kinds) and not isinstance(value, bool)
    kind = origin or hint
    return hint is Any or not isinstance(kind, type) or isinstance(value, kind)


_WORDS = {
    int: "a whole number",
    float: "a number",
    str: "text",
    bool: "true or false",
    NoneType: "null",
}


def _in_words(hint: Any) -> str:
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return " or ".join(map(_in_words, arguments))
    if origin is Literal:
        return " or ".join(map(repr, arguments))
    if origin in (Sequence, list, tuple):
        return f"a list, each {_in_words(arguments[0])}"
    if origin is dict or hint is dict:
        return "values by name"
    return _WORDS.get(hint, str(getattr(hint, "__name__", hint)))


def _leaf(_: str, value: Any) -> Any:
    return value.to_dict() if isinstance(value, SettingsGroup) else value
