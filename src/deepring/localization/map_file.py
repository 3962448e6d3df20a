"""A map as one file: a header of plain values and tensors, memory-mapped (safetensors).

Nothing in it is executed when it is read. The header says its version and has a SHA-256 of its own
and of every tensor: the first is checked when a file is opened, the others by `verify`.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor

from deepring.errors import DeepringError
from deepring.io.files import write_tensors

#: Raise when what a file holds, or what it means, changes.
FORMAT_VERSION = 2

_KEY = "deepring_map"
_WANTED = "expected a map as `deepring map build` writes it"


def write_map(path: Path, header: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> None:
    """Write header and tensors, whole or not at all."""
    whole = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    sums = {name: _sum_of(tensor) for name, tensor in whole.items()}
    text = json.dumps({"version": FORMAT_VERSION, "tensors": sums, **header}, sort_keys=True)
    sealed = json.dumps({"header": text, "sha256": _sha256(text.encode())})
    write_tensors(path, whole, {_KEY: sealed})


def read_map(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Header and memory-mapped tensors.

    Raises DeepringError for a file that is missing, no map, cut short, of another version, or
    with an altered header.
    """
    if not path.is_file():
        raise DeepringError(f"map {path}: no such file; {_WANTED}")
    with _damage_told(path), safe_open(path, framework="pt") as file:
        metadata = file.metadata() or {}
        if _KEY not in metadata:
            raise DeepringError(f"map {path}: safetensors without a header of ours; {_WANTED}")
        sealed = json.loads(metadata[_KEY])
        header = json.loads(sealed["header"])
        if header.get("version") != FORMAT_VERSION:
            raise DeepringError(
                f"map {path}: format version {header.get('version')!r}, expected "
                f"{FORMAT_VERSION}; build it again with this version of deepring"
            )
        if _sha256(sealed["header"].encode()) != sealed["sha256"]:
            raise DeepringError(f"map {path}: its header was altered; copy or build it again")
        names = sorted(file.keys())
        if names != sorted(header["tensors"]):
            raise DeepringError(f"map {path}: holds other tensors than its header says; {_WANTED}")
        return header, {name: file.get_tensor(name) for name in names}


def verify(path: Path, header: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> None:
    """Read every byte. Raises DeepringError where a tensor is not what was written."""
    for name, tensor in tensors.items():
        if _sum_of(tensor) != header["tensors"][name]:
            raise DeepringError(
                f"map {path}: {name} was altered, or damaged on the way; copy or build it again"
            )


@contextmanager
def _damage_told(path: Path) -> Iterator[None]:
    try:
        yield
    except (SafetensorError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DeepringError(
            f"map {path}: {error}; {_WANTED}; this is another file, or it was cut short or "
            "altered: copy or build it again"
        ) from error


def _sum_of(tensor: Tensor) -> str:
    kind = json.dumps([str(tensor.dtype), list(tensor.shape)]).encode()
    return _sha256(kind, tensor.reshape(-1).view(torch.uint8).numpy().data)


def _sha256(*parts: bytes | memoryview) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return digest.hexdigest()
