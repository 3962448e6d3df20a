"""What became of one input: read right, refused as it should be, or one of several faults."""

import gc
import math
import re
import traceback
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import deepring
from deepring.errors import DeepringError
from fuzz.files import Format, UndecidedError, UndecodableError
from fuzz.limits import Limits, TimedOut, limited

#: Right outcomes: the same values as from the good files, other ones that the decoder reads too, or
#: that no decoder can judge; a refusal, and one of files that the decoder reads.
AS_BEFORE, RIGHT, UNCHECKED = "as before", "right", "unchecked"
REFUSED, STRICTER = "refused", "stricter"
GOOD = (AS_BEFORE, RIGHT, UNCHECKED, REFUSED, STRICTER)

#: Faults.
EXCEPTION, WARNING, MESSAGE, HANG = "exception", "warning", "message", "hang"
MEMORY, CRASH, WRONG = "memory", "crash", "wrong"
BAD = (EXCEPTION, WARNING, MESSAGE, HANG, MEMORY, CRASH, WRONG)

#: The folder of the package, whatever that of the checkout is called.
PACKAGE = f"{Path(deepring.__file__).parent}/"

#: A library's words in a message are noticed from this length on.
_QUOTE = 15


@dataclass(frozen=True)
class Outcome:
    """The kind of an outcome, and what was seen, by which faults are grouped."""

    kind: str
    detail: str = ""
    said: str = ""
    """The message, or other particulars of this input alone."""

    @property
    def is_bad(self) -> bool:
        """Whether it is a fault."""
        return self.kind in BAD


def outcome_of(
    format: Format, folder: Path, files: Mapping[str, bytes], good: Any, limits: Limits
) -> Outcome:
    """Use the files, which lie in ``folder``, and judge what comes of it.

    ``good`` are the values that the good files give.
    """
    size = sum(map(len, files.values()))
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            with limited(limits, size):
                value = format.use(folder)
    except TimedOut as error:
        return Outcome(HANG, _where(error))
    except DeepringError as error:
        named = None if hasattr(error, "in_memory") else folder
        return _refusal(format, files, error, named, caught)
    except Exception as error:
        kind = MEMORY if _out_of_memory(error) else EXCEPTION
        words = f"{type(error).__name__}: {_short(error)} in {_where(error)}"
        return Outcome(kind, words, str(error)[:200])
    finally:
        gc.collect(0)
    if caught:
        return Outcome(WARNING, f"{caught[0].category.__name__}: {_short(caught[0].message)}")
    return _judged(format, files, value, good)


def same(a: Any, b: Any) -> bool:
    """Whether plain values are equal, numbers up to rounding and NaN to itself."""
    if isinstance(a, float) and isinstance(b, int | float):
        return math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-6) or (a != a and b != b)
    if isinstance(a, list | tuple):
        if not isinstance(b, list | tuple) or len(a) != len(b):
            return False
        return a == b or all(map(same, a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    return bool(a == b)


def message_fault(error: DeepringError, folder: Path | None) -> str | None:
    """What is wrong with the words of a refusal, or None."""
    text = str(error)
    if not text.isprintable():
        return "several lines" if "\n" in text else "control characters"
    if folder is not None and str(folder) not in text:
        return "does not name the file"
    if "Traceback" in text or re.search(r"\b(object at 0x|Errno)\b", text):
        return "the text of a program"
    if len(text) > 1500:
        return f"{len(text) // 1000}000 characters and more"
    for cause in _causes(error):
        words = str(cause).strip()
        if not _is_own(cause) and len(words) >= _QUOTE and words in text:
            return f"the words of {type(cause).__name__}"
    return None


def _refusal(
    format: Format,
    files: Mapping[str, bytes],
    error: DeepringError,
    folder: Path | None,
    caught: list[Any],
) -> Outcome:
    if any(map(_out_of_memory, _causes(error))):
        return Outcome(MEMORY, f"taken for damage in {_where(error)}")
    if fault := message_fault(error, folder):
        said = str(error).replace(str(folder), "IN")
        return Outcome(MESSAGE, f"{fault} in {_where(error)}", said[:300])
    if caught:
        return Outcome(WARNING, f"{caught[0].category.__name__}: {_short(caught[0].message)}")
    kind = STRICTER if _is_read(format, files) else REFUSED
    return Outcome(kind, f"{type(error).__name__} in {_where(error)}", str(error))


def _is_read(format: Format, files: Mapping[str, bytes]) -> bool:
    """Whether files of a format that others define are read by the decoder."""
    try:
        return format.foreign and format.decode is not None and bool(format.decode(files))
    except (UndecodableError, UndecidedError):
        return False


def _judged(format: Format, files: Mapping[str, bytes], value: Any, good: Any) -> Outcome:
    before = same(value, good)
    if format.decode is None:
        return Outcome(AS_BEFORE if before else UNCHECKED)
    try:
        expected = format.decode(files)
    except UndecodableError as error:
        return Outcome(WRONG, f"read, but {_short(error)}", str(error))
    except UndecidedError:
        return Outcome(AS_BEFORE if before else UNCHECKED)
    if not same(value, expected):
        return Outcome(WRONG, f"other values: {_first_difference(value, expected)}")
    return Outcome(AS_BEFORE if before else RIGHT)


def _first_difference(ours: Any, theirs: Any, at: str = "") -> str:
    """Where two values differ first, without the values, so that faults can be grouped."""
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for key in ours:
            if key not in theirs or not same(ours[key], theirs[key]):
                return _first_difference(ours[key], theirs.get(key), f"{at}.{key}")
        return f"{at} lacks {sorted(set(theirs) - set(ours))}"
    if isinstance(ours, list | tuple) and isinstance(theirs, list | tuple):
        if len(ours) != len(theirs):
            return f"{at} of another length"
        for mine, yours in zip(ours, theirs, strict=True):
            if not same(mine, yours):
                return _first_difference(mine, yours, f"{at}[]")
    return at or "all"


def _causes(error: BaseException) -> Iterator[BaseException]:
    seen: set[int] = set()
    left: list[BaseException | None] = [error.__cause__, error.__context__]
    while left:
        cause = left.pop()
        if cause is not None and id(cause) not in seen:
            seen.add(id(cause))
            yield cause
            left += [cause.__cause__, cause.__context__]


def _is_own(error: BaseException) -> bool:
    """Whether the words of an error are the package's, or may be told as they are."""
    if isinstance(error, DeepringError | OSError | KeyError | UnicodeError):
        return True
    frames = traceback.extract_tb(error.__traceback__)
    return bool(frames) and frames[-1].filename.startswith(PACKAGE)


def _out_of_memory(error: BaseException) -> bool:
    words = str(error)
    return isinstance(error, MemoryError) or (
        isinstance(error, RuntimeError | OSError)
        and ("allocate memory" in words or ("alloc" in words.lower() and "memory" in words.lower()))
    )


def _where(error: BaseException) -> str:
    """The innermost line of the package."""
    frames = [
        f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(PACKAGE)
    ]
    if not frames:
        return "a library"
    inner = frames[-1]
    return f"{inner.filename.removeprefix(PACKAGE)}:{inner.name}"


def _short(error: Any) -> str:
    """An error's first words, with numbers left out so that equal faults look alike."""
    return re.sub(r"\d+", "N", str(error).strip().split("\n")[0])[:80]
