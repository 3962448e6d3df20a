"""Checks plain values from JSON against types, and builds dataclasses from them."""

import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from deepring.checks import one_of
from deepring.errors import ConfigError

_PLAIN = {
    bool: "true or false",
    int: "a whole number",
    str: "text",
}


def typed(kind: Any, value: Any, name: str) -> Any:
    """The value, converted to ``kind``.

    Args:
        kind: bool, int, float, str, a ``Literal``, ``list[...]``, ``tuple[...]``,
            ``dict[str, ...]``, ``... | None``, ``Any``, or a dataclass of such fields, whose
            value is a mapping of exactly its fields' names.
        value: plain value; sequences are lists.
        name: name of the value, for messages.

    Raises:
        ConfigError: a value of another type, or one that a dataclass rejects.

    >>> typed(tuple[int, int] | None, [60, 31], "shape")
    (60, 31)
    >>> typed(tuple[int, int] | None, [60, 31.5], "shape")
    Traceback (most recent call last):
    deepring.errors.ConfigError: shape[1]: 31.5, expected a whole number
    """
    if kind is Any:
        return value
    if is_dataclass(kind):
        return _dataclass(kind, value, name)
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Literal:
        return one_of(name, value, kind)
    if origin in (Union, UnionType):
        if value is None and NoneType in inner:
            return None
        (kind,) = (each for each in inner if each is not NoneType)
        return typed(kind, value, name)
    if origin is dict:
        _expect(isinstance(value, dict), name, value, "an object of named values")
        return {key: typed(inner[1], each, f"{name}.{key}") for key, each in value.items()}
    if origin is list or (origin is tuple and inner[-1] is ...):
        _expect(isinstance(value, list), name, value, "a list")
        return origin(typed(inner[0], each, f"{name}[{k}]") for k, each in enumerate(value))
    if origin is tuple:
        _expect(
            isinstance(value, list) and len(value) == len(inner),
            name,
            value,
            f"a list of {len(inner)}",
        )
        both = zip(inner, value, strict=True)
        return tuple(typed(one, each, f"{name}[{k}]") for k, (one, each) in enumerate(both))
    if kind is float:
        return _float(name, value)
    _expect(type(value) is kind, name, value, _PLAIN[kind])
    return value


def field_values(value: Any) -> dict[str, Any]:
    """The values of a dataclass by name, for ``json.dumps(..., default=field_values)``.

    Raises TypeError for anything else.
    """
    return {field.name: getattr(value, field.name) for field in fields(value)}


def differing_names(values: Mapping[str, Any], names: set[str], optional: set[str]) -> list[str]:
    """Descriptions of the names that are missing from ``values``, and of the unknown ones."""
    missing = sorted(names - optional - set(values))
    unknown = sorted(set(values) - names)
    problems = [f"lacks {', '.join(missing)}"] if missing else []
    return problems + ([f"has an unknown {', '.join(unknown)}"] if unknown else [])


def _dataclass(kind: Any, value: Any, name: str) -> Any:
    _expect(isinstance(value, dict), name, value, "an object of named values")
    names = {field.name for field in fields(kind)}
    if problems := differing_names(value, names, set()):
        raise ConfigError(f"{name}: {' and '.join(problems)}; expected {', '.join(sorted(names))}")
    hints = get_type_hints(kind)
    return kind(**{key: typed(hints[key], value[key], f"{name}.{key}") for key in names})


def _float(name: str, value: Any) -> float:
    _expect(type(value) in (int, float), name, value, "a number")
    try:
        return float(value)
    except OverflowError:
        raise ConfigError(
            f"{name}: {value!r}, expected a number up to {sys.float_info.max:g}"
        ) from None


def _expect(condition: bool, name: str, value: Any, description: str) -> None:
    if not condition:
        text = repr(value)
        text = text if len(text) <= 80 else f"{text[:77]}..."
        raise ConfigError(f"{name}: {text}, expected {description}")
