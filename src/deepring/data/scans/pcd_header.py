"""The header of PCD files, versions 0.5 to 0.7, that of the Point Cloud Library."""

from dataclasses import dataclass

import numpy as np

from deepring.data.scans.content import LARGEST, Buffer, ContentError

ENCODINGS = ("ascii", "binary", "binary_compressed")

_TYPES = {
    **{("F", 4): "<f4", ("F", 8): "<f8"},
    **{("I", size): f"<i{size}" for size in (1, 2, 4, 8)},
    **{("U", size): f"<u{size}" for size in (1, 2, 4, 8)},
}
_KEYWORDS = (
    *("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS"),
    "DATA",
)
_UNUSED = ("VERSION", "VIEWPOINT")
PADDING = "_"
_LONGEST_HEADER = 1 << 20  # bytes, to stop in files of other types


@dataclass(frozen=True)
class PcdField:
    """One field of a point."""

    name: str
    type: np.dtype
    count: int

    @property
    def size(self) -> int:
        """Bytes of one point."""
        return self.type.itemsize * self.count


@dataclass(frozen=True)
class PcdHeader:
    """What the lines before the points say."""

    fields: tuple[PcdField, ...]
    points: int
    end: int
    """Byte at which the points begin."""
    data: str
    """Encoding of the points, one of `ENCODINGS`."""

    @property
    def record(self) -> int:
        """Bytes of one point."""
        return sum(field.size for field in self.fields)


def read_header(content: Buffer) -> PcdHeader:
    """The header of the content of a PCD file. Raises ContentError for what is none."""
    values: dict[str, list[str]] = {}
    end = 0
    while "DATA" not in values:
        start, end = end, content.find(b"\n", end, _LONGEST_HEADER) + 1
        if not end:
            raise ContentError("a header without a line DATA")
        line = content[start : end - 1].decode("latin-1").strip()
        if not line or line.startswith("#"):
            continue
        keyword, *words = line.split()
        keyword = "FIELDS" if keyword == "COLUMNS" else keyword  # its name in old files
        known = keyword in _KEYWORDS and (words or keyword in _UNUSED)
        if not known or not line.isascii():
            raise ContentError(f"the header line {line[:80]!r}")
        if keyword in values:
            raise ContentError(f"two header lines {keyword}")
        values[keyword] = words
    data = " ".join(values["DATA"]).lower()
    if data not in ENCODINGS:
        raise ContentError(f"DATA {data[:80]}, not {', '.join(ENCODINGS)}")
    return PcdHeader(_fields(values), _count_of_points(values), end, data)


def _fields(values: dict[str, list[str]]) -> tuple[PcdField, ...]:
    if "FIELDS" not in values:
        raise ContentError("a header without a line FIELDS")
    names = values["FIELDS"]
    # Old files leave out what the library takes as its own default.
    kinds = values.get("TYPE", ["F"] * len(names))
    sizes = _numbers(values, "SIZE", [4] * len(names))
    counts = _numbers(values, "COUNT", [1] * len(names))
    for keyword, list_ in (("TYPE", kinds), ("SIZE", sizes), ("COUNT", counts)):
        if len(list_) != len(names):
            raise ContentError(f"{len(list_)} values of {keyword} for {len(names)} FIELDS")
    fields = []
    for name, kind, size, count in zip(names, kinds, sizes, counts, strict=True):
        if (kind, size) not in _TYPES:
            raise ContentError(f"TYPE {kind[:8]} with SIZE {size} of field {name[:40]}")
        if not count:
            raise ContentError(f"COUNT 0 of field {name[:40]}")
        fields.append(PcdField(name, np.dtype(_TYPES[kind, size]), count))
    if (record := sum(field.size for field in fields)) > LARGEST:
        raise ContentError(f"{record} bytes of one point")
    return tuple(fields)


def _count_of_points(values: dict[str, list[str]]) -> int:
    width, height, points = (
        _numbers(values, keyword, [-1]) for keyword in ("WIDTH", "HEIGHT", "POINTS")
    )
    if any(len(numbers) != 1 for numbers in (width, height, points)):
        raise ContentError("several values of WIDTH, HEIGHT or POINTS")
    if width[0] < 0:
        if height[0] >= 0 or points[0] < 0:
            raise ContentError("a header without a line WIDTH")
        return points[0]
    count = width[0] * (1 if height[0] < 0 else height[0])
    if points[0] not in (count, -1):
        raise ContentError(
            f"WIDTH {width[0]} and HEIGHT {height[0]} in its header, but POINTS {points[0]}"
        )
    return count


def _numbers(values: dict[str, list[str]], keyword: str, default: list[int]) -> list[int]:
    """The whole numbers of a header line."""
    words = values.get(keyword)
    if words is None:
        return default
    if not all(word.isascii() and word.isdigit() and len(word) < 19 for word in words):
        raise ContentError(f"the header line {keyword} {' '.join(words)[:80]!r}")
    return [int(word) for word in words]
