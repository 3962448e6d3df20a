"""Sealed files: safetensors with a header of JSON under digests, by their definition alone."""

import hashlib
import json
import math
import struct
from typing import Any

from fuzz.files import UndecodableError

#: Bytes of a value, by safetensors' names of types.
SIZES = {
    "F64": 8,
    "I64": 8,
    "F32": 4,
    "I32": 4,
    "F16": 2,
    "BF16": 2,
    "I16": 2,
    "I8": 1,
    "U8": 1,
    "BOOL": 1,
}
NAMES = {
    **{"F64": "float64", "I64": "int64", "F32": "float32", "I32": "int32", "F16": "float16"},
    **{"BF16": "bfloat16", "I16": "int16", "I8": "int8", "U8": "uint8", "BOOL": "bool"},
}

#: dtype, shape and bytes of a tensor.
Tensor = tuple[str, list[int], bytes]


def decode(content: bytes, kind: str) -> tuple[dict[str, Any], dict[str, Tensor], str]:
    """The plain values, the tensors and the header's digest of a file of one kind."""
    if len(content) < 8:
        raise UndecodableError("no safetensors file")
    (size,) = struct.unpack_from("<Q", content)
    if size > len(content) - 8:
        raise UndecodableError("no safetensors file")
    layout = _json(content[8 : 8 + size])
    metadata = layout.pop("__metadata__", None)
    if not isinstance(metadata, dict) or not isinstance(metadata.get("deepring_sealed"), str):
        raise UndecodableError("no sealed file")
    digest, _, text = metadata["deepring_sealed"].partition("\n")
    if hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest() != digest:
        raise UndecodableError("a header of another digest")
    stated = _json(text.encode("utf-8", "surrogatepass"))
    if set(stated) != {"kind", "version", "tensors", "values"} or stated["kind"] != kind:
        raise UndecodableError("a header of another kind")
    if not isinstance(stated["tensors"], dict) or not isinstance(stated["values"], dict):
        raise UndecodableError("a header of another kind")
    body = content[8 + size :]
    tensors = {name: _tensor(entry, body) for name, entry in layout.items()}
    if set(tensors) != set(stated["tensors"]):
        raise UndecodableError("tensors other than the header's")
    for name, (dtype, shape, data) in tensors.items():
        entry = stated["tensors"][name]
        expected = {"dtype": dtype, "shape": shape, "sha256": hashlib.sha256(data).hexdigest()}
        if entry != expected:
            raise UndecodableError("a tensor other than the header's")
    return stated["values"], tensors, digest


def floats(tensor: Tensor) -> list[float]:
    """The numbers of a tensor of float64 or float32."""
    dtype, _, data = tensor
    layout = {"float64": "<d", "float32": "<f", "int64": "<q"}.get(dtype)
    if layout is None:
        raise UndecodableError(f"a tensor of {dtype}")
    return [value for (value,) in struct.iter_unpack(layout, data)]


def _tensor(entry: Any, body: bytes) -> Tensor:
    try:
        dtype, shape, (start, end) = entry["dtype"], entry["shape"], entry["data_offsets"]
        data = body[start:end]
        right = len(data) == end - start == math.prod(shape) * SIZES[dtype]
    except (KeyError, TypeError, ValueError, OverflowError):
        raise UndecodableError("no safetensors file") from None
    if not right:
        raise UndecodableError("a tensor cut short")
    return NAMES[dtype], shape, data


def _json(raw: bytes) -> dict[str, Any]:
    try:
        value = json.loads(raw.decode("utf-8", "surrogatepass"))
    except (ValueError, RecursionError):
        raise UndecodableError("no JSON") from None
    if not isinstance(value, dict):
        raise UndecodableError("no JSON object")
    return value
