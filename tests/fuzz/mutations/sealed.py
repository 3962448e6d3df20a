"""Sealed files and other safetensors files, forged: their digests are right, their contents not."""

import hashlib
import json
import struct
from random import Random
from typing import Any, NamedTuple

from fuzz.decoders.sealed import NAMES, SIZES
from fuzz.files import Files, Mutation
from fuzz.mutations.values import as_json, changed

_KEY = "deepring_sealed"


class Tensor(NamedTuple):
    """A tensor of a safetensors file."""

    dtype: str
    shape: list[int]
    data: bytes


class Parts(NamedTuple):
    """A sealed file taken apart."""

    stated: dict[str, Any]
    """The header's JSON."""
    tensors: dict[str, Tensor]


def parts_of(content: bytes) -> Parts:
    """What a good file holds."""
    (size,) = struct.unpack_from("<Q", content)
    header = json.loads(content[8 : 8 + size])
    stated = json.loads(header.pop("__metadata__")[_KEY].partition("\n")[2])
    body = content[8 + size :]
    tensors = {}
    for name, entry in header.items():
        start, end = entry["data_offsets"]
        tensors[name] = Tensor(entry["dtype"], entry["shape"], body[start:end])
    return Parts(stated, tensors)


def put_together(text: str, tensors: dict[str, Tensor], digest: str | None = None) -> bytes:
    """A file whose header text has the right digest."""
    digest = (
        hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
        if digest is None
        else digest
    )
    header: dict[str, Any] = {"__metadata__": {_KEY: f"{digest}\n{text}"}}
    at = 0
    # safetensors wants the largest types first, so that all are aligned.
    for name, tensor in sorted(tensors.items(), key=lambda item: (-SIZES[item[1].dtype], item[0])):
        end = at + len(tensor.data)
        header[name] = {"dtype": tensor.dtype, "shape": tensor.shape, "data_offsets": [at, end]}
        at = end
    raw = json.dumps(header).encode()
    raw += b" " * (-len(raw) % 8)
    ordered = sorted(tensors.items(), key=lambda item: (-SIZES[item[1].dtype], item[0]))
    return struct.pack("<Q", len(raw)) + raw + b"".join(tensor.data for _, tensor in ordered)


def entries_of(tensors: dict[str, Tensor]) -> dict[str, Any]:
    """What a sealed header states of its tensors."""
    return {
        name: {
            "dtype": NAMES[tensor.dtype],
            "shape": tensor.shape,
            "sha256": hashlib.sha256(tensor.data).hexdigest(),
        }
        for name, tensor in tensors.items()
    }


def forged_values(*names: str) -> Mutation:
    """Other plain values in the header, under a right digest."""

    def mutate(rng: Random, files: Files) -> str:
        name = rng.choice(names)
        stated, tensors = parts_of(files[name])
        if rng.random() < 0.85:
            stated["values"], done = changed(rng, stated["values"])
        else:
            stated, done = changed(rng, stated)
        return _sealed(files, name, as_json(stated), tensors, f"values: {done}")

    return mutate


def forged_tensors(*names: str) -> Mutation:
    """Other tensors: values, shapes, types, or without some, under right digests."""

    def mutate(rng: Random, files: Files) -> str:
        name = rng.choice(names)
        stated, tensors = parts_of(files[name])
        done = [_change_tensors(rng, tensors) for _ in range(rng.choice((1, 1, 2)))]
        stated["tensors"] = entries_of(tensors)
        if rng.random() < 0.3:
            stated["values"], words = changed(rng, stated["values"])
            done.append(words)
        return _sealed(files, name, as_json(stated), tensors, f"tensors: {', '.join(done)}")

    return mutate


def forged_layout(*names: str) -> Mutation:
    """Another safetensors header over the same bytes: the seal is as it was, or a false one."""

    def mutate(rng: Random, files: Files) -> str:
        name = rng.choice(names)
        content = files[name]
        (size,) = struct.unpack_from("<Q", content)
        header = json.loads(content[8 : 8 + size])
        if rng.random() < 0.2:
            stated, tensors = parts_of(content)
            text = as_json(changed(rng, stated)[0])
            files[name] = put_together(text, tensors, rng.choice(("0" * 64, "", "\x1b[31m")))
            return f"{name}: a false digest"
        header, done = changed(rng, header)
        raw = as_json(header).encode("utf-8", "replace")
        length = len(raw) + (rng.choice((0, 0, 0, 0, 1, -1, 2**40, 2**63)))
        files[name] = struct.pack("<Q", length % 2**64) + raw + content[8 + size :]
        return f"{name}: layout: {done}"

    return mutate


def _sealed(files: Files, name: str, text: str, tensors: dict[str, Tensor], done: str) -> str:
    files[name] = put_together(text, tensors)
    return f"{name}: {done}"


def _change_tensors(rng: Random, tensors: dict[str, Tensor]) -> str:
    if not tensors:
        tensors["extra"] = Tensor("F32", [1], bytes(4))
        return "an extra tensor"
    # Networks have many tensors, places a few.
    groups = sorted({name.partition(".")[0] for name in tensors})
    group = rng.choice(groups)
    name = rng.choice(sorted(name for name in tensors if name.partition(".")[0] == group))
    tensor = tensors[name]
    kind = rng.randrange(12)
    if kind == 0:
        del tensors[name]
        return f"without {name}"
    if kind == 1:
        tensors[rng.choice((f"{name}2", "index.code", "images", "x", ""))] = tensor
        return f"a copy of {name}"
    if kind == 2:
        other = rng.choice(sorted(tensors))
        tensors[name], tensors[other] = tensors[other], tensor
        return f"{name} and {other} swapped"
    if kind in (3, 4):
        shape = _other_shape(rng, tensor.shape)
        data = (tensor.data * (1 + _count(shape)))[: _count(shape) * SIZES[tensor.dtype]]
        data = data.ljust(_count(shape) * SIZES[tensor.dtype], b"\0")
        tensors[name] = Tensor(tensor.dtype, shape, data)
        return f"{name} of shape {shape}"
    if kind == 5:
        dtype = rng.choice(sorted(SIZES))
        size = _count(tensor.shape) * SIZES[dtype]
        tensors[name] = Tensor(dtype, tensor.shape, tensor.data[:size].ljust(size, b"\0"))
        return f"{name} as {dtype}"
    fills = {6: b"\xff", 7: b"\0", 8: b"\x7f"}
    if kind in fills and rng.random() < 0.4:
        data = fills[kind] * len(tensor.data)
    else:
        data = _damaged(rng, tensor)
    tensors[name] = tensor._replace(data=data)
    return f"{name} with other values"


def _damaged(rng: Random, tensor: Tensor) -> bytes:
    if not tensor.data:
        return b""
    size = SIZES[tensor.dtype]
    values = [float("nan"), float("inf"), 1e38, 0.0, -1.0, 1e-38]
    words = [struct.pack({4: "<f", 8: "<d"}[size], v) for v in values] if size in (4, 8) else []
    words.append(rng.randbytes(size))
    data = bytearray(tensor.data)
    for _ in range(rng.choice((1, 3, 50))):
        at = rng.randrange(len(data) // size) * size
        data[at : at + size] = rng.choice(words)
    return bytes(data)


def _other_shape(rng: Random, shape: list[int]) -> list[int]:
    new = list(shape)
    kind = rng.randrange(6)
    if kind == 0 or not new:
        return [*new, rng.choice((0, 1, 2))][-3:] if new else [rng.choice((0, 1, 2))]
    k = rng.randrange(len(new))
    if kind == 1:
        new[k] += rng.choice((1, -1, 7))
    elif kind == 2:
        new[k] = 0
    elif kind == 3:
        new.reverse()
    elif kind == 4:
        new = [_count(new)]
    else:
        del new[k]
    return [max(0, n) for n in new]


def _count(shape: list[int]) -> int:
    product = 1
    for n in shape:
        product *= n
    return product
