"""Type hints held against the plain values of a config, and said in words."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

_WORDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text",
    NoneType: "null",
}

_LISTS = (list, tuple, Iterable, Sequence, Collection)


def fits(hint: Any, value: Any) -> bool:
    """Whether a plain value may be an argument of this type; true where the type is no plain one.

    The node of an object fits every type, since the object is made of it first.

    >>> fits(int | list[int], 5), fits(int | list[int], [1, 2.5]), fits(float, True)
    (True, False, False)
    """
    origin, inner = get_origin(hint), get_args(hint)
    if isinstance(value, Mapping) and "_target_" in value:
        return True
    if origin in (Union, UnionType):
        kinds = [kind for kind in inner if _is_plain(kind)]
        return not kinds or any(fits(kind, value) for kind in kinds)
    if not _is_plain(hint):
        return True
    if origin is Literal:
        return any(type(value) is type(choice) and value == choice for choice in inner)
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    if hint in _WORDS:
        return type(value) is hint
    if (origin or hint) is dict:
        return isinstance(value, Mapping)
    kinds = [kind for kind in inner if kind is not ...]
    return isinstance(value, list | tuple) and (
        not kinds or all(any(fits(kind, each) for kind in kinds) for each in value)
    )


def in_words(hint: Any) -> str:
    """What to expect of a type, in words; empty where the type is no plain one.

    >>> in_words(float | None)
    'a number or null'
    >>> in_words(int | list[int] | Literal["auto"])
    'a whole number, a list, as [1, 2] or auto'
    """
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        kinds = list(dict.fromkeys(in_words(kind) for kind in inner if _is_plain(kind)))
        return " or ".join([", ".join(kinds[:-1]), kinds[-1]] if len(kinds) > 1 else kinds)
    if origin is Literal:
        return " or ".join(map(str, inner))
    if hint in _WORDS:
        return _WORDS[hint]
    if is_dataclass(hint):
        return f"values by name: {', '.join(field.name for field in fields(hint))}"
    if (origin or hint) is dict:
        return "values by name"
    if (origin or hint) in _LISTS:
        return "a list, as [a, b]" if inner[:1] == (str,) else "a list, as [1, 2]"
    return ""


def without_none(hint: Any) -> Any:
    """The type that a value has unless it is None, where there is one."""
    if get_origin(hint) not in (Union, UnionType):
        return hint
    others = [kind for kind in get_args(hint) if kind is not NoneType]
    return others[0] if len(others) == 1 else hint


def _is_plain(hint: Any) -> bool:
    origin = get_origin(hint) or hint
    return hint in _WORDS or origin in (*_LISTS, dict, Literal)
