"""Folders of ROS 2: metadata.yaml, and the files that it names."""

from collections import Counter
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from deepring.data.scans.bags.fields import text
from deepring.data.scans.bags.storage import named_type
from deepring.data.scans.names import files_with
from deepring.errors import BrokenScanError, DataError, FileError
from deepring.io.plain_yaml import plain_yaml
from deepring.text import shown

_ENDINGS = {"mcap": ".mcap", "sqlite3": ".db3"}


class Folder(NamedTuple):
    """What metadata.yaml says of a bag."""

    files: list[Path]
    compressed: bool
    """Whether the files are compressed as a whole, with zstd."""
    counts: dict[tuple[str, str], int]
    """Messages of each topic and type."""


def read_folder(path: Path) -> Folder:
    """The folder of a bag, by its metadata.yaml.

    The files' order and numbers of messages are taken from it, and whether they are compressed;
    their topics and types are in the files themselves. QoS profiles have no part in reading.

    Raises:
        BrokenScanError: metadata.yaml is not that of a bag.
        DataError: a storage or a compression that is not read.
        FileError: a file that is missing, or is there and not named.
    """
    try:
        whole = plain_yaml((path / "metadata.yaml").read_bytes())
        found = whole["rosbag2_bagfile_information"]
        storage = str(found["storage_identifier"])
        names = [PurePosixPath(str(name)).name for name in found["relative_file_paths"]]
        form = str(found.get("compression_format") or "")
        mode = str(found.get("compression_mode") or "").lower()
        counts: Counter[tuple[str, str]] = Counter()
        for topic in found["topics_with_message_count"] or []:
            name, kind = (_text(topic["topic_metadata"][key]) for key in ("name", "type"))
            counts[name, named_type(kind)] += int(topic["message_count"])
    except (DataError, LookupError, TypeError, ValueError, AttributeError) as error:
        raise BrokenScanError("its metadata.yaml is damaged") from error
    if storage not in _ENDINGS:
        raise DataError(f"stored as {shown(_text(storage), 60)}; expected {' or '.join(_ENDINGS)}")
    if mode not in ("", "none", "message", "file") or (mode not in ("", "none") and form != "zstd"):
        how = f"{shown(_text(form), 60)} by {shown(_text(mode), 60)}"
        raise DataError(f"compressed with {how}; expected zstd")
    _check_files(path, names, _ENDINGS[storage])
    return Folder([path / name for name in names], mode == "file", dict(counts))


def _check_files(path: Path, names: list[str], ending: str) -> None:
    """Raise an error unless the named files are those of the folder, each named once."""
    if not names or len(set(names)) < len(names):
        found = "twice the same file" if names else "no files"
        raise DataError(f"metadata.yaml names {found}; `ros2 bag reindex` corrects it")
    for name in names:
        if not name.removesuffix(".zstd").endswith(ending):
            raise DataError(f"metadata.yaml names {_text(name)}; expected a name with {ending}")
        if not (path / name).is_file():
            raise FileError(f"metadata.yaml names {_text(name)}, which is missing; copy it there")
    known = {*names, *(name.removesuffix(".zstd") for name in names)}
    others = [file.name for file in files_with(path, (ending,)) if file.name not in known]
    if others:
        raise FileError(
            f"{_text(', '.join(others))} is in the folder and not in metadata.yaml; `ros2 bag "
            "reindex` takes it in, or move it elsewhere"
        )


def _text(value: Any) -> str:
    return text(str(value).encode("utf-8", "replace"))
