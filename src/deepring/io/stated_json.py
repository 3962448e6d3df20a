"""JSON objects that state what they hold: their first key is the ``schema``, with its version."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from deepring.schemas import schema_id


def json_text(name: str, content: Mapping[str, Any], indent: int | None = 2) -> str:
    """One object of the schema ``name``, in ASCII, so that it prints under every encoding.

    Numbers that JSON lacks, NaN and infinity, are null.

    >>> print(json_text("written", {"command": "report", "written": [Path("a")]}, indent=None))
    {"schema": "deepring.written/1", "command": "report", "written": ["a"]}
    """
    values = {"schema": schema_id(name), **content}
    return json.dumps(_plain(values), indent=indent, allow_nan=False)


def _plain(value: Any) -> Any:
    """The value with paths as text, and null for numbers that JSON lacks."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
