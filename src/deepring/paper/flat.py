"""Configs as flat values, for comparing: one dotted key per value, and values as text."""

import json
from collections.abc import Mapping
from typing import Any

from deepring.io.typed import plain

#: Keys by which no run gives other results, as a regular expression: where it lies, what it shows,
#: how it goes on.
INDIFFERENT = (
    r"(stages\.[^.]+\.)?(((resume|paths|workers|logger|experiment_name|sweep_name"
    r"|callbacks\.(progress|learning_rate))(\..*)?)|callbacks\..*\.dirpath)"
)


def flatten(node: Any, prefix: str = "") -> dict[str, Any]:
    """Nested dicts as one with dotted keys; null is the same as absent, 10.0 the same as 10."""
    if not isinstance(node, Mapping):
        return {} if node is None else {prefix: plain(node, _whole)}
    flat: dict[str, Any] = {}
    for key, value in node.items():
        flat |= flatten(value, f"{prefix}.{key}" if prefix else str(key))
    return flat


def _whole(_: str, value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


def frozen(value: Any) -> str:
    """A config value, or several by key, as text: equal values give equal text, 10 and 10.0 too."""
    return json.dumps(value, sort_keys=True, default=str)
