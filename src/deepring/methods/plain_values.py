"""Plain values: what a file's header, a checkpoint and a config can hold."""

from collections.abc import Callable
from typing import Any


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
