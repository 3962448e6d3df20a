"""Files of JSON in which runs and sweeps keep their state."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from deepring.errors import DeepringError, FileError
from deepring.io.strict_json import read_json

T = TypeVar("T")


def read_record(path: Path, parsed: Callable[[Any], T], what: str, expected: str) -> T | None:
    """What a file holds, or None without one.

    Args:
        path: the file.
        parsed: makes it of the JSON value; may raise.
        what: it holds, such as "a status".
        expected: what else to do, behind the reason.

    Raises FileError if the file cannot be read, or does not hold it.
    """
    try:
        return parsed(read_json(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    except DeepringError as error:
        reason = str(error)
    except OSError as error:
        reason = f"cannot be read ({error.strerror})"
    except (ValueError, TypeError, AttributeError, KeyError):
        reason = f"does not hold {what} as JSON"
    raise FileError(f"{path}: {reason}; expected {expected}")
