"""What commands print as JSON, held against the schemas of the package."""

import json
from typing import Any

from jsonschema import Draft202012Validator

from deepring.schemas import read_schema, schema_id


def of_schema(name: str, text: str) -> dict[str, Any]:
    """The one object that the text is, after a check that it is of the schema."""
    content = json.loads(text)
    assert content["schema"] == schema_id(name)
    expect_valid(name, content)
    return content


def expect_valid(name: str, content: Any) -> None:
    """Raise AssertionError, with every place that differs, unless the content is of the schema."""
    errors = Draft202012Validator(read_schema(name)).iter_errors(content)
    told = [f"{error.json_path}: {error.message}" for error in errors]
    assert not told, "\n".join(told)
