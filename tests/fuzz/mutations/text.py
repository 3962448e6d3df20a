"""Changes to tables and other texts: numbers, separators, rows, encodings."""

import re
from random import Random

from fuzz.files import Files, Mutation

#: What a number may be replaced by.
NUMBERS = (
    *("nan", "NaN", "inf", "-inf", "Infinity", "1e999", "-1e999", "1e-999", "-0", "+5", "0x10"),
    *("1_000", "1,5", "1.5.2", "--3", "1e", "e5", "9" * 40, "-" + "9" * 25, "9223372036854775807"),
    *("9223372036854775808", "-9223372036854775809", "18446744073709551616", "1e18", "1d3", "0"),
    *("1" * 5000, "0." + "0" * 400 + "1", "", " ", "None", "null", "true", '"1"', "1L", "1/2"),
    *("\N{ARABIC-INDIC DIGIT THREE}", "\N{FULLWIDTH DIGIT SEVEN}", "\N{SUPERSCRIPT TWO}", "½"),
    *("\N{MINUS SIGN}4", "1\N{NO-BREAK SPACE}2", "\x1b[31m", "\0", "1e5", "0.5", "-1", "1000000"),
)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_SEPARATORS = (" ", ",", ";", "\t", ", ", "  ", "|", "\N{NO-BREAK SPACE}", "\x0b", " \t", ",,", "#")


def number(rng: Random, text: str) -> str:
    """One number replaced by another or by what is none."""
    found = list(_NUMBER.finditer(text))
    if not found:
        return text
    match = rng.choice(found)
    return text[: match.start()] + rng.choice(NUMBERS) + text[match.end() :]


def nudged(rng: Random, text: str) -> str:
    """One number larger or smaller by little or much, or of the other sign."""
    found = list(_NUMBER.finditer(text))
    if not found:
        return text
    match = rng.choice(found)
    value = match.group()
    if rng.random() < 0.3:
        new = value[1:] if value.startswith("-") else f"-{value}"
    elif "." in value or "e" in value.lower():
        new = repr(float(value) * rng.choice((1.0000001, 1.001, 2.0, -1.0, 1e6, 0.0)))
    else:
        new = str(int(value) + rng.choice((-1, 1, 1000, -(10**9), 10**9)))
    return text[: match.start()] + new + text[match.end() :]


def separator(rng: Random, text: str) -> str:
    """Other separators in one row or in all."""
    new = rng.choice(_SEPARATORS)
    lines = text.split("\n")
    rows = range(len(lines)) if rng.random() < 0.4 else [rng.randrange(len(lines))]
    for k in rows:
        lines[k] = re.sub(r"[ ,\t]+", new.replace("\\", r"\\"), lines[k].strip())
    return "\n".join(lines)


def rows(rng: Random, text: str) -> str:
    """Rows twice, left out, swapped, cut, in reverse or shuffled, or blank ones."""
    lines = text.split("\n")
    k, m = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(8)
    if kind == 0:
        lines.insert(m, lines[k])
    elif kind == 1:
        del lines[k : k + rng.choice((1, 1, 5))]
    elif kind == 2:
        lines[k], lines[m] = lines[m], lines[k]
    elif kind == 3:
        lines.reverse()
    elif kind == 4:
        rng.shuffle(lines)
    elif kind == 5:
        lines.insert(k, rng.choice(("", "   ", "# a remark", "stamp,x,y,z", "\t", "//", "%")))
    elif kind == 6:
        lines[k] = lines[k][: rng.randrange(len(lines[k]) + 1)]
    else:
        lines = lines[:1] * rng.choice((2, 3))
    return "\n".join(lines)


def fields(rng: Random, text: str) -> str:
    """A value of a row more, less, empty or in another place."""
    lines = text.split("\n")
    k = rng.randrange(len(lines))
    parts = re.split(r"([ ,\t:=]+)", lines[k])
    m = rng.randrange(len(parts))
    kind = rng.randrange(4)
    if kind == 0:
        parts.insert(m, rng.choice(("1", ",", " ", ",1", " 1")))
    elif kind == 1:
        del parts[m]
    elif kind == 2:
        parts[m] = ""
    else:
        other = rng.randrange(len(parts))
        parts[m], parts[other] = parts[other], parts[m]
    lines[k] = "".join(parts)
    return "\n".join(lines)


def words(rng: Random, text: str) -> str:
    """A word in other case, twice, left out, or replaced by another word of the text."""
    found = list(re.finditer(r"[A-Za-z_][A-Za-z_0-9]*", text))
    if not found:
        return text
    match, other = rng.choice(found), rng.choice(found).group()
    word = match.group()
    new = rng.choice(
        (word.upper(), word.lower(), word * 2, "", other, f"{word}é", f"\x1b[1m{word}")
    )
    return text[: match.start()] + new + text[match.end() :]


#: Encoders of the whole text.
_ENCODINGS = ("utf-8-sig", "utf-16", "utf-16-le", "latin-1", "utf-8")
_LINE_ENDS = ("\r\n", "\r", "\n\r", "\x0b", "\N{LINE SEPARATOR}", "\n\n", "\x85")


def encoded(rng: Random, text: str) -> bytes:
    """The text in another encoding, or with other ends of lines, or with a byte that is none."""
    if rng.random() < 0.5:
        return text.encode(rng.choice(_ENCODINGS), errors="replace")
    if rng.random() < 0.7:
        return text.replace("\n", rng.choice(_LINE_ENDS)).encode()
    data = text.encode()
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice((b"\xff", b"\x80", b"\xc3", b"\0", b"\xed\xa0\x80")) + data[at:]


ALL = (number, number, number, nudged, separator, rows, rows, fields, words)


def text(*names: str) -> Mutation:
    """One to three changes to one of the named texts."""

    def mutate(rng: Random, files: Files) -> str:
        name = rng.choice(names)
        content, done = files[name].decode(), []
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            change = rng.choice(ALL)
            content = change(rng, content)
            done.append(change.__name__)
        if rng.random() < 0.1:
            files[name] = encoded(rng, content)
            done.append("encoded")
        else:
            files[name] = content.encode()
        return f"{name}: {', '.join(done)}"

    return mutate
