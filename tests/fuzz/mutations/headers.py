"""Headers of text before binary points: PCD, PLY and NPY, forged or with changed lines."""

import ast
import re
import struct
from random import Random

from fuzz.files import Files, Mutation
from fuzz.mutations.text import NUMBERS

_COUNTS = (
    "0",
    "1",
    "-1",
    "2",
    "3",
    "100",
    "161",
    "4294967295",
    "99999999999",
    "1.0",
    "1e3",
    "",
    "+5",
)
_PCD_LINES = {
    "VERSION": ("0.7", ".7", ".5", "0.6", "7", "0.8", ""),
    "FIELDS": ("x y z", "X Y Z", "x y z intensity", "z y x", "x x x", "x y", "_ x y z", "x y z _"),
    "SIZE": ("4 4 4", "8 8 8", "2 2 2", "4 4", "4 4 4 4", "0 4 4", "3 3 3", "1 1 1", "-4 4 4"),
    "TYPE": ("F F F", "I I I", "U U U", "f f f", "F F", "S F F", "F F F F", "D D D"),
    "COUNT": ("1 1 1", "0 1 1", "2 1 1", "1 1", "1 1 1 1", "99999999 1 1", "-1 1 1"),
    "WIDTH": _COUNTS,
    "HEIGHT": _COUNTS,
    "VIEWPOINT": ("0 0 0 1 0 0 0", "0 0 0", "nan nan nan nan nan nan nan", "1 2 3 0 1 0 0"),
    "POINTS": _COUNTS,
    "DATA": ("ascii", "binary", "binary_compressed", "BINARY", "binary_compressed ", "zip", ""),
}
_PLY_TYPES = (
    "float",
    "double",
    "int",
    "uchar",
    "short",
    "int8",
    "float32",
    "uint",
    "string",
    "long",
)


def pcd_header(name: str) -> Mutation:
    """A line of a PCD header with another value, twice, left out, or elsewhere."""
    return _lines(name, re.compile(rb"DATA[^\n]*\n"), _pcd_line)


def ply_header(name: str) -> Mutation:
    """A line of a PLY header with another value, twice, left out, or elsewhere."""
    return _lines(name, re.compile(rb"end_header\n"), _ply_line)


def _lines(name: str, last: "re.Pattern[bytes]", change) -> Mutation:
    def mutate(rng: Random, files: Files) -> str:
        content = files[name]
        match = last.search(content)
        if match is None:
            return "no header"
        lines = content[: match.end() - 1].decode().split("\n")
        done = []
        for _ in range(rng.choice((1, 1, 2, 3))):
            k = rng.randrange(len(lines))
            kind = rng.randrange(8)
            if kind == 0:
                lines.insert(rng.randrange(len(lines)), lines[k])
                done.append(f"{lines[k][:12]!r} twice")
            elif kind == 1 and len(lines) > 1:
                done.append(f"without {lines[k][:12]!r}")
                del lines[k]
            elif kind == 2:
                m = rng.randrange(len(lines))
                lines[k], lines[m] = lines[m], lines[k]
                done.append("lines swapped")
            else:
                lines[k] = change(rng, lines[k])
                done.append(repr(lines[k][:30]))
        files[name] = "\n".join(lines).encode() + b"\n" + content[match.end() :]
        return f"{name}: header: {', '.join(done)}"

    return mutate


def _pcd_line(rng: Random, line: str) -> str:
    key = line.split(" ")[0]
    if key in _PCD_LINES and rng.random() < 0.8:
        return f"{key} {rng.choice(_PCD_LINES[key])}"
    return _word(rng, line)


def _ply_line(rng: Random, line: str) -> str:
    words = line.split()
    if words[:1] == ["property"] and rng.random() < 0.7:
        words[rng.randrange(1, len(words))] = rng.choice((*_PLY_TYPES, "x", "y", "list", "vertex"))
        return " ".join(words)
    if words[:1] == ["element"] and rng.random() < 0.7:
        words[rng.choice((1, 2, 2))] = rng.choice((*_COUNTS, "vertex", "face"))
        return " ".join(words)
    if words[:1] == ["format"]:
        forms = ("ascii", "binary_little_endian", "binary_big_endian", "binary")
        return f"format {rng.choice(forms)} {rng.choice(('1.0', '2.0', '', '1.0 1'))}"
    return _word(rng, line)


def _word(rng: Random, line: str) -> str:
    words = line.split(" ")
    words[rng.randrange(len(words))] = rng.choice(NUMBERS)
    return " ".join(words)


_DESCRS = (
    *("<f4", ">f4", "<f8", "<i4", "<u2", "|u1", "<f2", "<c8", "|O", "|b1", "<U5", "<M8[ns]", "f4"),
    *(
        "",
        "<f16",
        "<f3",
        "|V12",
        [("x", "<f4"), ("y", "<f4"), ("z", "<f4")],
        [],
        None,
        7,
        "O",
        "<i8",
    ),
)
_SHAPES = (
    *((160, 3), (3, 160), (480,), (0, 3), (1, 3), (161, 3), (159, 3), (160, 2), (160, 3, 1), ()),
    *((10**12, 3), (2**40, 2**40), (-1, 3), (160.0, 3), (True, 3), 160, None, "x", (2**63, 3)),
)


def npy_header(name: str) -> Mutation:
    """An NPY header that states another type, order, shape, version or length."""

    def mutate(rng: Random, files: Files) -> str:
        content = files[name]
        wide = content[6] > 1
        (size,) = struct.unpack_from("<I" if wide else "<H", content, 8)
        start = 12 if wide else 10
        header = ast.literal_eval(content[start : start + size].decode().strip())
        version = content[6]
        for _ in range(rng.choice((1, 1, 2))):
            kind = rng.randrange(8)
            if kind < 2:
                header["descr"] = rng.choice(_DESCRS)
            elif kind < 4:
                header["shape"] = rng.choice(_SHAPES)
            elif kind == 4:
                header["fortran_order"] = rng.choice((True, False, 1, None, "no"))
            elif kind == 5:
                header[rng.choice(("descr", "shape", "extra", "fortran_order"))] = rng.choice(
                    (1, "x", {}, [])
                )
            elif kind == 6:
                version = rng.choice((0, 1, 2, 3, 4, 255))
            else:
                header.pop(rng.choice(("descr", "shape", "fortran_order")), None)
        text = repr(header)
        if rng.random() < 0.1:
            text = rng.choice(
                ("(" * 3000 + ")" * 3000, "{}", "", "[" * 200, text[:-1], f"{text};1")
            )
        raw = text.encode() + b"\n"
        length = len(raw) + rng.choice((0, 0, 0, 0, 0, 1, -1, 10**4))
        prefix = b"\x93NUMPY" + bytes([version, 0])
        layout = "<I" if version > 1 else "<H"
        prefix += struct.pack(layout, length % (2**32 if version > 1 else 2**16))
        files[name] = prefix + raw + content[start + size :]
        return f"{name}: header {text[:90]}, version {version}"

    return mutate


def lzf_stream(name: str) -> Mutation:
    """Other compressed points: control bytes, references, and stated sizes."""

    def mutate(rng: Random, files: Files) -> str:
        content = files[name]
        start = content.index(b"DATA binary_compressed\n") + len(b"DATA binary_compressed\n")
        packed, whole = struct.unpack_from("<II", content, start)
        stream = bytearray(content[start + 8 :])
        kind = rng.randrange(6)
        if kind == 0:
            stream[rng.randrange(len(stream))] = rng.choice((0, 31, 32, 224, 255))
        elif kind == 1:
            del stream[rng.randrange(len(stream)) :]
        elif kind == 2:
            stream += bytes([0xFF, 0xFF, 0xFF]) * rng.choice((1, 100, 5000))
        elif kind == 3:
            at = rng.randrange(len(stream))
            stream[at : at + 2] = rng.randbytes(2)
        elif kind == 4:
            stream = bytearray(rng.randbytes(rng.choice((0, 1, 10, len(stream)))))
        sizes = [len(stream) if rng.random() < 0.7 else packed, whole]
        if kind == 5 or rng.random() < 0.2:
            sizes[rng.randrange(2)] = rng.choice((0, 1, whole + 1, whole * 2, 2**31, 2**32 - 1))
        files[name] = content[:start] + struct.pack("<II", *sizes) + bytes(stream)
        return f"{name}: LZF stream {kind}, sizes {sizes}"

    return mutate
