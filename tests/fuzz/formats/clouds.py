"""Scans: .bin records of every layout, PCD, PLY and NPY."""

import struct
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from deepring.data.scans.scan_files import read_scan
from deepring.rasters import BevRaster
from fuzz.decoders import npy, pcd, ply, points
from fuzz.decoders.lzf import compress
from fuzz.files import Files, Format
from fuzz.mutations.headers import lzf_stream, npy_header, pcd_header, ply_header
from fuzz.mutations.raw import raw
from fuzz.mutations.text import text
from fuzz.scenes import Point, scene, with_missing

_RASTER = BevRaster(cells=24)

#: Layouts of records that begin with x, y, z as float32, with values for what follows.
RECORDS: dict[str, tuple[str, tuple[float, ...]]] = {
    "mulran": ("<4f", (0.5,)),
    "kitti": ("<4f", (0.25,)),
    "helipr_ouster": ("<4fI3H", (1.0, 99, 5, 6, 7)),
    "helipr_velodyne": ("<4fHf", (2.0, 11, 0.5)),
    "helipr_avia": ("<3f3BI", (1, 2, 3, 400)),
    "helipr_aeva": ("<5fiB", (1.0, -0.5, 4000, 3)),
}


def formats() -> Iterator[Format]:
    """All formats of scans."""
    clouds = scene(1), scene(2)
    for name, (layout, rest) in RECORDS.items():
        content = b"".join(struct.pack(layout, *p, *rest) for p in with_missing(clouds[0]))
        layouts = ("<5fiBf", layout) if name == "helipr_aeva" else (layout,)
        yield _scan(name, "1.bin", content, partial(points.records, layouts=layouts), (), name)
    hits = b"".join(struct.pack("<3HBB", *map(_nclt, (x, -y, -z)), 9, 3) for x, y, z in clouds[0])
    yield _scan("nclt", "1.bin", hits, points.nclt, (), "nclt")
    for form in ("ascii", "binary", "binary_compressed"):
        content = _pcd(form, with_missing(clouds[0]))
        extra = (lzf_stream("a.pcd"), lzf_stream("a.pcd")) if form == "binary_compressed" else ()
        header = pcd_header("a.pcd")
        yield _scan(f"pcd {form}", "a.pcd", content, pcd.decode, (header, header, *extra))
    organised = _organised(clouds[1])
    header = pcd_header("a.pcd")
    yield _scan("pcd of rows", "a.pcd", organised, pcd.decode, (header, header))
    for form in ("ascii", "binary_little_endian", "binary_big_endian"):
        content = _ply(form, clouds[1])
        header = ply_header("a.ply")
        yield _scan(f"ply {form}", "a.ply", content, ply.decode, (header, header))
    for name, array in {
        "npy": np.array(with_missing(clouds[1]), np.float32),
        "npy doubles": np.asfortranarray(np.array(clouds[1], ">f8")),
    }.items():
        content = _npy(array)
        yield _scan(name, "a.npy", content, npy.decode, (npy_header("a.npy"), npy_header("a.npy")))


def _scan(
    name: str,
    file: str,
    content: bytes,
    decode: Callable[[bytes], Any],
    headers: tuple[Any, ...],
    binary: str | None = None,
) -> Format:
    others = (content[::-1], _ply("ascii", scene(5)), _pcd("binary", scene(6)))
    mutations = [raw(file, others=others), *headers]
    if "ascii" in name:
        mutations.append(text(file))
    return Format(
        name,
        lambda _: {file: content},
        tuple(mutations),
        lambda folder: _points(folder / file, binary),
        lambda files: decode(files[file]),
        foreign=True,
    )


def _points(path: Path, binary: str | None) -> Any:
    cloud = read_scan(path, binary)
    _RASTER(cloud, -1.8)
    return cloud.tolist()


def _nclt(metres: float) -> int:
    return round((metres + 100) / 0.005)


def _pcd(form: str, cloud: list[Point]) -> bytes:
    """Points with an intensity and a padding field, as PCL writes them."""
    lines = (
        *("# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", "FIELDS x y z _ intensity"),
        *("SIZE 4 4 4 1 4", "TYPE F F F U F", "COUNT 1 1 1 4 1", f"WIDTH {len(cloud)}", "HEIGHT 1"),
        *("VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {len(cloud)}", f"DATA {form}"),
    )
    if form == "ascii":
        lines = tuple(line for line in lines)
        rows = "".join(f"{x!r} {y!r} {z!r} 0 0 0 0 0.5\n" for x, y, z in cloud)
        return ("\n".join(lines) + "\n" + rows).encode()
    header = ("\n".join(lines) + "\n").encode()
    if form == "binary":
        return header + b"".join(struct.pack("<3f4Bf", *p, 0, 0, 0, 0, 0.5) for p in cloud)
    columns = [struct.pack(f"<{len(cloud)}f", *column) for column in zip(*cloud, strict=True)]
    columns += [bytes(4 * len(cloud)), struct.pack("<f", 0.5) * len(cloud)]
    packed = compress(b"".join(columns))
    return header + struct.pack("<II", len(packed), 20 * len(cloud)) + packed


def _organised(cloud: list[Point]) -> bytes:
    """Rows and columns of doubles, with names in capitals and numbers of other types between."""
    lines = (
        *("VERSION .6", "FIELDS Ring X Y Z Label", "SIZE 2 8 8 8 4", "TYPE U F F F I"),
        *("COUNT 1 1 1 1 2", f"WIDTH {len(cloud) // 4}", "HEIGHT 4", f"POINTS {len(cloud)}"),
        "DATA binary",
    )
    rows = b"".join(struct.pack("<H3d2i", k % 4, *p, k, -1) for k, p in enumerate(cloud))
    return ("\n".join(lines) + "\n").encode() + rows


def _ply(form: str, cloud: list[Point]) -> bytes:
    """Vertices as doubles with a colour, and two faces after them."""
    lines = (
        *("ply", f"format {form} 1.0", "comment a scan", f"element vertex {len(cloud)}"),
        *("property double x", "property double y", "property double z", "property uchar red"),
        *("element face 2", "property list uchar int vertex_indices", "end_header"),
    )
    header = ("\n".join(lines) + "\n").encode()
    if form == "ascii":
        rows = "".join(f"{x!r} {y!r} {z!r} 7\n" for x, y, z in cloud) + "3 0 1 2\n4 0 1 2 3\n"
        return header + rows.encode()
    order = ">" if "big" in form else "<"
    rows = b"".join(struct.pack(f"{order}3dB", *p, 7) for p in cloud)
    faces = struct.pack(f"{order}B3i", 3, 0, 1, 2) + struct.pack(f"{order}B4i", 4, 0, 1, 2, 3)
    return header + rows + faces


def _npy(array: np.ndarray) -> bytes:
    import io

    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


__all__ = ["Files", "formats"]
