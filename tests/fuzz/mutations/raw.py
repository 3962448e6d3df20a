"""Damage to the bytes of any file: flips, cuts, insertions, repetitions, splices, zeros."""

import struct
from collections.abc import Callable, Sequence
from random import Random

from fuzz.files import Files, Mutation

#: Beginnings of files of other types.
MAGIC = (
    *(b"PK\x03\x04", b"\x1f\x8b\x08", b"\x89PNG\r\n\x1a\n", b"SQLite format 3\0", b"\x93NUMPY"),
    *(b"ply\n", b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"version https://git-lfs.github.com/spec/v1"),
    *(b"\xef\xbb\xbf", b"\xff\xfe", b"<!DOCTYPE html>", b"\x80\x02", b"# .PCD v0.7\n"),
)

#: Numbers that counts and offsets may be replaced by.
EXTREMES = (
    0,
    1,
    2,
    3,
    7,
    255,
    256,
    65535,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**53,
    2**63 - 1,
    2**64 - 1,
)


def flip(rng: Random, content: bytes) -> bytes:
    """One to eight bits flipped."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 8))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def random_bytes(rng: Random, content: bytes) -> bytes:
    """A few bytes replaced by random ones."""
    start = rng.randrange(len(content))
    new = rng.randbytes(rng.choice((1, 2, 4, 8, 64)))
    return content[:start] + new + content[start + len(new) :]


def cut_end(rng: Random, content: bytes) -> bytes:
    """Only the beginning, as after a full disk."""
    return content[: rng.choice((rng.randrange(len(content)), len(content) - rng.randint(1, 20)))]


def cut_out(rng: Random, content: bytes) -> bytes:
    """A piece left out."""
    start = rng.randrange(len(content))
    return content[:start] + content[start + rng.choice((1, 2, 4, 8, 16, 100, 4096)) :]


def insert(rng: Random, content: bytes) -> bytes:
    """A piece of random bytes, or of zeros, inserted or appended."""
    start = rng.choice((rng.randrange(len(content)), len(content), 0))
    size = rng.choice((1, 2, 4, 8, 16, 64))
    return content[:start] + rng.choice((rng.randbytes(size), bytes(size))) + content[start:]


def repeat(rng: Random, content: bytes) -> bytes:
    """A piece twice, or the whole file."""
    if rng.random() < 0.2:
        return content + content
    start = rng.randrange(len(content))
    end = start + rng.choice((1, 4, 8, 16, 64, 512))
    return content[:end] + content[start:end] + content[end:]


def zeros(rng: Random, content: bytes) -> bytes:
    """A block of zeros, as sparse copies leave."""
    start = rng.randrange(len(content))
    size = min(rng.choice((1, 4, 16, 512, len(content))), len(content) - start)
    return content[:start] + bytes(size) + content[start + size :]


def magic(rng: Random, content: bytes) -> bytes:
    """The beginning of another type of file, in place of its own or before it."""
    other = rng.choice(MAGIC)
    return other + content[rng.choice((0, len(other))) :]


def extreme(rng: Random, content: bytes) -> bytes:
    """A small or a huge integer anywhere, near the beginning more often."""
    number = rng.choice(EXTREMES)
    size = rng.choice((1, 2, 4, 8))
    new = (number % 256**size).to_bytes(size, rng.choice(("little", "big")))
    start = rng.randrange(min(len(content), rng.choice((32, 256, len(content)))))
    return content[:start] + new + content[start + size :]


def special_float(rng: Random, content: bytes) -> bytes:
    """NaN, infinity or a huge number, aligned."""
    kind, size = rng.choice((("f", 4), ("d", 8)))
    value = rng.choice((float("nan"), float("inf"), -float("inf"), 3e38, -0.0, 1e-40))
    new = struct.pack(rng.choice("<>") + kind, value)
    start = rng.randrange(max(1, len(content) // size)) * size
    return content[:start] + new + content[start + size :]


def emptied(rng: Random, content: bytes) -> bytes:
    """Nothing, a newline, or zeros of the same length."""
    return rng.choice((b"", b"\n", bytes(len(content))))


def other_order(rng: Random, content: bytes) -> bytes:
    """The bytes of all words reversed, as on a machine of the other order."""
    size = rng.choice((2, 4, 8))
    whole = len(content) // size * size
    words = [content[k : k + size][::-1] for k in range(0, whole, size)]
    return b"".join(words) + content[whole:]


ALL: tuple[Callable[[Random, bytes], bytes], ...] = (
    *(flip, flip, random_bytes, cut_end, cut_out, insert, repeat, zeros),
    *(magic, extreme, special_float, emptied, other_order),
)


def raw(*names: str, others: Sequence[bytes] = ()) -> Mutation:
    """One to three kinds of damage to one of the named files, or a splice with another file."""

    def mutate(rng: Random, files: Files) -> str:
        name = rng.choice(names)
        content, done = files[name], []
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            if not content:
                break
            if others and rng.random() < 0.06:
                other = rng.choice(others)
                content = (
                    content[: rng.randrange(len(content))] + other[rng.randrange(len(other)) :]
                )
                done.append("splice")
            else:
                damage = rng.choice(ALL)
                content = damage(rng, content)
                done.append(damage.__name__)
        files[name] = content
        return f"{name}: {', '.join(done)}"

    return mutate
