"""Plain values, as JSON and configs give them, checked against types and made into dataclasses."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from deepring.checks import one_of
from deepring.errors import ConfigError
from deepring.text import shown

_PLAIN = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text",
    NoneType: "null",
}


def typed(kind: Any, value: Any, name: str, *, whole: bool = True) -> Any:
    """The value as ``kind`` has it: sequences are tuples or lists, whole numbers floats.

    Args:
        kind: bool, int, float, str, a ``Literal``, ``Sequence[...]`` (which becomes a tuple),
            ``list[...]``, ``tuple[...]``, ``dict[str, ...]``, several of them, ``Any``, or a
            dataclass, whose value is a mapping of its fields' names. Any other class takes its
            objects.
        value: plain; sequences are lists or tuples. A dataclass of this kind stays.
        name: of the value, for messages.
        whole: all fields of a dataclass have to be stated, as in a file; otherwise those that are
            left out take their defaults, as in a config.

    Raises:
        ConfigError: a value of another type, and what a dataclass refuses. The message names a
            value within another as ``name.key`` or ``name[index]``.

    >>> typed(tuple[int, int] | None, [60, 31], "shape")
    (60, 31)
    >>> typed(tuple[int, int] | None, [60, 31.5], "shape")
    Traceback (most recent call last):
    deepring.errors.ConfigError: shape[1]: 31.5, expected a whole number
    """
    if kind is Any:
        return value
    if is_dataclass(kind):
        return value if isinstance(value, kind) else _dataclass(kind, value, name, whole)  # type: ignore[arg-type]
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Literal:
        return one_of(name, value, kind)
    if origin in (Union, UnionType):
        return _one_of_several(inner, value, name, whole)
    if origin is dict or kind is dict:
        _expect(isinstance(value, dict), name, value, "values by name")
        each_kind = inner[1] if inner else Any
        return typed_values(dict.fromkeys(value, each_kind), value, name, whole=whole)
    if origin in (list, tuple, Sequence):
        return _sequence(origin, inner, value, name, whole)
    if kind is float:
        return _float(name, value)
    if kind in _PLAIN:
        _expect(type(value) is kind, name, value, _PLAIN[kind])
    elif isinstance(kind, type):
        _expect(isinstance(value, kind), name, value, f"a {kind.__name__}")
    return value


def typed_values(
    hints: Mapping[str, Any],
    values: Any,
    name: str,
    required: Sequence[str] = (),
    *,
    whole: bool = True,
) -> dict[str, Any]:
    """The values by name, each as its type hint has it.

    Raises ConfigError for a name without a hint, a required one that is missing, and as `typed`.

    >>> typed_values({"stem": int, "norm": str}, {"stem": 2}, "encoder")
    {'stem': 2}
    >>> typed_values({"stem": int, "norm": str}, {"steam": 2}, "encoder")
    Traceback (most recent call last):
    deepring.errors.ConfigError: encoder.steam: unknown, expected one of stem, norm
    """
    known = ", ".join(map(str, hints))
    _expect(isinstance(values, Mapping), name, values, f"values by name: {known}")
    for key in values:
        if key not in hints:
            raise ConfigError(f"{name}.{key}: unknown, expected one of {known}")
    if missing := [key for key in required if key not in values]:
        raise ConfigError(f"{name}: lacks {', '.join(map(str, missing))}; expected {known}")
    return {
        key: typed(hints[key], value, f"{name}.{key}", whole=whole) for key, value in values.items()
    }


def plain(
    value: Any, leaf: Callable[[str, Any], Any] = lambda _, value: value, where: str = ""
) -> Any:
    """Nested dicts and sequences as dicts and lists.

    Args:
        value: of any type.
        leaf: what becomes of anything else, by its dotted key and value; it stays by default.
        where: the dotted key of ``value``.
    """
    if isinstance(value, dict):
        return {key: plain(item, leaf, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, leaf, where) for item in value]
    return leaf(where, value)


def field_values(value: Any) -> dict[str, Any]:
    """The values of a dataclass by name, for ``json.dumps(..., default=field_values)``.

    Raises TypeError for anything else.
    """
    return {field.name: getattr(value, field.name) for field in fields(value)}


def _dataclass(kind: Any, value: Any, name: str, whole: bool) -> Any:
    hints, taken = get_type_hints(kind), [field for field in fields(kind) if field.init]
    required = [f.name for f in taken if whole or f.default is f.default_factory is MISSING]
    known = {f.name: hints[f.name] for f in taken}
    return kind(**typed_values(known, value, name, required, whole=whole))


def _one_of_several(kinds: Sequence[Any], value: Any, name: str, whole: bool) -> Any:
    """The value as the first kind has it that takes it."""
    if value is None and NoneType in kinds:
        return None
    complex_kinds = [kind for kind in kinds if kind not in _PLAIN]
    if len(kinds) == 1 + (NoneType in kinds) and complex_kinds:
        return typed(
            complex_kinds[0], value, name, whole=whole
        )  # its message names what is wrong within
    for kind in kinds:
        try:
            return typed(kind, value, name, whole=whole)
        except ConfigError:
            continue
    words = (_PLAIN.get(kind) or str(getattr(kind, "__name__", kind)) for kind in kinds)
    return _expect(False, name, value, " or ".join(words))


def _sequence(origin: Any, inner: Sequence[Any], value: Any, name: str, whole: bool) -> Any:
    of_length = None if origin is not tuple or inner[-1] is ... else len(inner)
    right = isinstance(value, list | tuple) and of_length in (None, len(value))
    _expect(right, name, value, "a list" if of_length is None else f"a list of {of_length}")
    kinds = [inner[0]] * len(value) if of_length is None else inner
    both = enumerate(zip(kinds, value, strict=True))
    made = [typed(kind, each, f"{name}[{k}]", whole=whole) for k, (kind, each) in both]
    return made if origin is list else tuple(made)


def _float(name: str, value: Any) -> float:
    _expect(type(value) in (int, float), name, value, "a number")
    try:
        return float(value)
    except OverflowError:
        raise ConfigError(
            f"{name}: {shown(value, 80)}, expected a number up to {sys.float_info.max:g}"
        ) from None


def _expect(condition: bool, name: str, value: Any, description: str) -> None:
    if not condition:
        raise ConfigError(f"{name}: {shown(value, 80)}, expected {description}")
