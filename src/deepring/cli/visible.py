"""Texts from files and arguments, such as names, made safe to print in one line."""

import unicodedata

#: Kinds of characters that would move the cursor, change the terminal, or hide what is written.
_HIDDEN = ("Cc", "Cf", "Zl", "Zp")


def visible(text: str, keep: str = "") -> str:
    r"""The text with every control character but those of ``keep`` as its escape.

    >>> visible("a\nb\x1b[2J.bin")
    'a\\nb\\x1b[2J.bin'
    """
    return "".join(
        character.encode("unicode_escape").decode()
        if unicodedata.category(character) in _HIDDEN and character not in keep
        else character
        for character in text
    )
