"""Zip files with other contents of their entries, under right checksums."""

import io
import pickletools
import zipfile
from random import Random

from fuzz.files import Files, Mutation
from fuzz.mutations.raw import ALL

#: Opcodes of pickles that build or call something.
_OPCODES = b"cRibjo\x81\x82\x93\x92QP."


def zip_entries(name: str) -> Mutation:
    """An entry with other bytes, left out, twice, or under another name."""

    def mutate(rng: Random, files: Files) -> str:
        entries = _entries(files[name])
        entry = rng.choice(sorted(entries))
        kind, done = rng.randrange(9), ""
        if rng.random() < 0.02:
            # A file of kilobytes that stands for much more than a process may take.
            entries[entry] = bytes(400 << 20)
            files[name] = _zip(entries, zipfile.ZIP_DEFLATED)
            return f"{name}: {entry} of 400 MB of zeros"
        if kind == 0:
            del entries[entry]
            done = f"without {entry}"
        elif kind == 1:
            other = rng.choice(sorted(entries))
            entries[entry], entries[other] = entries[other], entries[entry]
            done = f"{entry} and {other} swapped"
        elif kind == 2:
            new = rng.choice(("../../escaped", "/etc/x", "archive/data/99", "", "a" * 300, "x\x1b"))
            entries[new] = entries.pop(entry)
            done = f"{entry} as {new!r}"
        elif kind < 6:
            entry = next(e for e in entries if e.endswith("data.pkl"))
            entries[entry] = _pickle(rng, entries[entry])
            done = f"{entry}: other pickle"
        else:
            damage = rng.choice(ALL)
            entries[entry] = damage(rng, entries[entry] or b"\0")
            done = f"{entry}: {damage.__name__}"
        packed = rng.choice((zipfile.ZIP_STORED,) * 4 + (zipfile.ZIP_DEFLATED,))
        files[name] = _zip(entries, packed)
        return f"{name}: {done}"

    return mutate


def _pickle(rng: Random, content: bytes) -> bytes:
    """Another opcode or argument of a pickle, at the beginning of an opcode."""
    places = [at for _, _, at in pickletools.genops(content)]
    at = rng.choice(places)
    kind = rng.randrange(4)
    if kind == 0:
        return content[:at] + bytes([rng.choice(_OPCODES)]) + content[at + 1 :]
    if kind == 1:
        return content[:at] + content[rng.choice(places) :]
    if kind == 2:
        call = rng.choice(
            (b"cos\nsystem\n", b"cbuiltins\neval\n", b"ctorch\nload\n", b"cno.such\nthing\n")
        )
        return content[:at] + call + b"X\x04\x00\x00\x00true\x85R0" + content[at:]
    return (
        content[: at + 1]
        + rng.choice((b"\xff\xff\xff\x7f", b"\0\0\0\0", rng.randbytes(4)))
        + content[at + 5 :]
    )


def _entries(content: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(content)) as parts:
        return {name: parts.read(name) for name in parts.namelist()}


def _zip(entries: dict[str, bytes], packed: int) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", packed) as parts:
        for name, content in entries.items():
            parts.writestr(zipfile.ZipInfo(name), content, packed)
    return buffer.getvalue()
