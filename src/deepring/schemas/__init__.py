"""The JSON schemas of what commands print and of drive.yaml, by name; docs/automation.md."""

import json
from importlib.resources import files
from typing import Any

from deepring.errors import ConfigError

#: Version of each schema. A new version may take keys away or change their meaning; within one,
#: keys may be added.
VERSIONS = {
    "case_study": 1,
    "dataset_check": 1,
    "diagnosis": 1,
    "drive_file": 1,
    "location": 1,
    "locations": 1,
    "loops": 1,
    "map": 1,
    "properties": 1,
    "results": 1,
    "status": 1,
    "sweep": 1,
    "tables": 1,
    "written": 1,
}


def schema_id(name: str) -> str:
    """What an object of the schema states as ``schema``.

    >>> schema_id("diagnosis")
    'deepring.diagnosis/1'
    """
    return f"deepring.{name}/{VERSIONS[name]}"


def schema_names() -> list[str]:
    """The names of all schemas."""
    return sorted(VERSIONS)


def read_schema(name: str) -> dict[str, Any]:
    """A schema (JSON Schema, draft 2020-12). Raises ConfigError for an unknown name."""
    if name not in VERSIONS:
        raise ConfigError(f"name: {name!r}, expected one of {', '.join(schema_names())}")
    content: dict[str, Any] = json.loads(schema_text(name))
    return content


def schema_text(name: str) -> str:
    """The file of a schema."""
    return (files("deepring.schemas") / f"{name}.json").read_text(encoding="utf-8")
