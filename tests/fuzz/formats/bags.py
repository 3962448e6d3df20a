"""ROS bags of all kinds, and point cloud messages by themselves."""

import math
import struct
import tempfile
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any

import numpy as np

from deepring.data.scans.bag_files import bag_scans
from deepring.data.scans.point_cloud2 import cloud_records
from fuzz.decoders import mcap as mcap_file
from fuzz.decoders import rosbag1, sqlite_bag
from fuzz.decoders.cloud_message import CloudMessage, encoded, of_cdr, points_of
from fuzz.files import Files, Format, Mutation, in_memory, read_back
from fuzz.mutations.messages import changed_message, forged_messages, mcap
from fuzz.mutations.raw import raw
from fuzz.mutations.text import text
from fuzz.scenes import scene
from helpers.bags import START, message, write_bag

_SCANS = 6


def formats() -> Iterator[Format]:
    """All bags."""
    decoders = {
        **dict.fromkeys(("bag", "bag bz2", "bag lz4"), rosbag1.decode),
        **{"mcap": mcap_file.decode, "db3": sqlite_bag.decode},
    }
    for name, decode in decoders.items():
        kind, _, compression = name.partition(" ")
        file = f"drive.{kind}"
        yield Format(
            f"bag {name}",
            partial(_written, kind, file, compression),
            (raw(file),),
            partial(_scans, file),
            lambda files, decode=decode, file=file: decode(files[file]),
            foreign=True,
        )
    yield Format(
        "bag folder",
        _folder,
        (text("drive/metadata.yaml"), raw("drive/metadata.yaml"), raw("drive/drive.db3")),
        partial(_scans, "drive"),
        lambda files: sqlite_bag.decode(files["drive/drive.db3"]),
    )
    messages = _messages()
    write = partial(mcap, start=START)
    good = write([encoded(each, cdr=True) for each in messages])
    forged = forged_messages("a.mcap", messages, write)
    yield Format(
        "bag mcap with checksums",
        lambda _: {"a.mcap": good},
        (forged, forged, forged, raw("a.mcap")),
        partial(_scans, "a.mcap"),
        lambda files: mcap_file.decode(files["a.mcap"]),
        foreign=True,
    )
    yield Format(
        "PointCloud2",
        lambda _: {"a.cdr": encoded(messages[0], cdr=True)},
        (_in_memory(messages[0]),),
        _points,
        _decoded,
    )


def _scans(file: str, folder: Path) -> Any:
    found = []
    for scan in bag_scans(folder / file):
        found.append([scan.stamp, scan.read().tolist()])
    return found


def _clouds() -> list[Any]:
    return [np.array(scene(k, 24), np.float32) for k in range(_SCANS)]


def _written(kind: str, file: str, compression: str, _: Path) -> Files:
    with tempfile.TemporaryDirectory() as folder:
        topics = {"/points": [message(c, after=4) for c in _clouds()], "/notes": ["a", "b"]}
        path = write_bag(Path(folder), kind, topics, compression=compression)
        return {file: path.read_bytes()}


def _folder(_: Path) -> Files:
    with tempfile.TemporaryDirectory() as folder:
        write_bag(
            Path(folder), "folder", {"/points": [message(c) for c in _clouds()], "/notes": ["a"]}
        )
        return read_back(Path(folder))


def _messages() -> list[CloudMessage]:
    found = []
    for k in range(_SCANS):
        cloud = scene(k, 24)
        data = b"".join(struct.pack("<3fI", *point, 0) for point in cloud)
        fields = [(axis, 4 * n, 7, 1) for n, axis in enumerate("xyz")]
        fields.append(("intensity", 12, 6, 1))
        found.append(CloudMessage(START + k * 10**8, 2, 12, fields, 0, 16, 192, data))
    return found


def _in_memory(good: CloudMessage) -> Mutation:
    def mutate(rng: Random, files: Files) -> str:
        changed, done = changed_message(rng, good)
        changed.bigendian &= 1
        files["a.cdr"] = encoded(changed, cdr=True)
        return done

    return mutate


def _points(folder: Path) -> Any:
    read = of_cdr((folder / "a.cdr").read_bytes())
    names = ("name", "offset", "datatype", "count")
    fields = [SimpleNamespace(**dict(zip(names, field, strict=True))) for field in read.fields]
    values = {
        **{"height": read.height, "width": read.width, "is_bigendian": bool(read.bigendian)},
        **{"point_step": read.point_step, "row_step": read.row_step, "fields": fields},
    }
    with in_memory():
        points = cloud_records(SimpleNamespace(**values, data=np.frombuffer(read.data, np.uint8)))
    return _kept(points)


def _kept(points: Any) -> Any:
    """Points without missing returns, which messages may hold."""
    return [p for p in points.tolist() if all(map(math.isfinite, p)) and any(p)]


def _decoded(files: Mapping[str, bytes]) -> Any:
    return points_of(of_cdr(files["a.cdr"]))
