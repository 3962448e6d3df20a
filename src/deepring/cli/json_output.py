"""What `--as json` prints: one object on standard output, whose ``schema`` says what it holds."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from deepring.schemas import schema_id


def print_json(name: str, content: Mapping[str, Any]) -> None:
    """Print one object, with ``schema`` as its first key; ``name`` is that of the schema."""
    print(json_text(name, content))


def json_text(name: str, content: Mapping[str, Any]) -> str:
    """One object as JSON. Numbers that JSON lacks, NaN and infinity, are null."""
    values = {"schema": schema_id(name), **content}
    return json.dumps(_plain(values), indent=2, ensure_ascii=False, allow_nan=False)


def _plain(value: Any) -> Any:
    """The value with paths as text, and null for numbers that JSON lacks."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
