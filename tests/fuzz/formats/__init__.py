"""Every format that is read: good files, how they are used, and what decodes them independently."""

from collections.abc import Iterator

from fuzz.files import Format
from fuzz.formats import bags, caches, clouds, networks, places, runs, tables

_FAMILIES = (clouds, tables, bags, places, networks, caches, runs)


def every_format() -> Iterator[Format]:
    """All formats, in a fixed order."""
    for family in _FAMILIES:
        yield from family.formats()
