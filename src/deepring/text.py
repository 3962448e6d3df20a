"""Foreign text as one may print it, and values as messages show them.

Names in files, and names of files, are chosen by others. They may hold control characters, which a
terminal obeys, or characters that reverse what is read.
"""

import reprlib
from typing import Any

#: Containers within a value up to which a message shows all of it.
_SMALL = 100


def printable(text: str) -> str:
    r"""The text on one line, with a backslash escape for whatever does not print.

    Control characters, line ends, marks of direction and lone surrogates do not print.

    >>> print(printable("scan\x1b[31m\n\u202e.bin"))
    scan\x1b[31m\n\u202e.bin
    """
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else _escaped(one) for one in text)


def printable_lines(text: str) -> str:
    r"""As `printable`, but the ends of lines stay.

    >>> print(printable_lines("a: 1\nb: \x07"))
    a: 1
    b: \x07
    """
    return "\n".join(map(printable, text.split("\n")))


def shown(value: Any, length: int = 200) -> str:
    """``repr`` of a value of any size, at most ``length`` characters, in short time.

    >>> shown([1.5, "a"])
    "[1.5, 'a']"
    >>> shown("x" * 1000, 12)
    "'xxxxxxxx..."
    """
    try:
        text = repr(value) if _is_small(value) else _short.repr(value)
    except ValueError:  # a whole number of thousands of digits
        text = f"<{type(value).__name__}>"
    return text if len(text) <= length else f"{text[: length - 3]}..."


def _escaped(character: str) -> str:
    return character.encode("unicode_escape", "surrogatepass").decode("ascii")


def _is_small(value: Any) -> bool:
    """Whether its repr is short enough to be made at all; names within names may double it."""
    left, waiting = _SMALL, [value]
    while waiting and left > 0:
        one = waiting.pop()
        left -= 1
        if isinstance(one, dict):
            waiting += [*one.keys(), *one.values()] if len(one) < left else [None] * left
        elif isinstance(one, list | tuple | set | frozenset):
            waiting += one if len(one) < left else [None] * left
        elif isinstance(one, str | bytes) and len(one) > 100 * _SMALL:
            return False
    return not waiting


_short = reprlib.Repr()
_short.maxlevel = 3
_short.maxstring = _short.maxother = 200
