"""Blocks of rows as files: a folder of safetensors shards, memory-mapped when opened.

A folder grows by further shards; those before are neither rewritten nor read. Nothing in them is
executed. ``index.safetensors`` holds what all rows share and comes last, so that a folder whose
writing was cut short opens as it was before.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from torch import Tensor

from deepring.errors import DeepringError
from deepring.io.files import write_tensors
from deepring.search.block_store import Block, lengths_of

#: Raise when what a folder holds, or what it means, changes.
FORMAT_VERSION = 2

_HEADER = "index.safetensors"
_KEY = "deepring_index"


def write_shard(folder: Path, number: int, block: Block) -> None:
    """Write one block, whole or not at all."""
    write_tensors(folder / f"{number:05d}.safetensors", block, {})


def write_header(
    folder: Path, tensors: Mapping[str, Tensor], values: Mapping[str, Any], lengths: list[int]
) -> None:
    """Write what all rows share, and how many rows each shard holds."""
    header = {"version": FORMAT_VERSION, "lengths": lengths, **values}
    write_tensors(folder / _HEADER, tensors, {_KEY: json.dumps(header)})


def read_header(folder: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """What all rows share. Raises DeepringError where there is no index of this version."""
    path = folder / _HEADER
    if not path.is_file():
        raise DeepringError(
            f"index {folder}: no {_HEADER} in it; expected a folder written by save"
        )
    tensors, metadata = _read(path)
    try:
        header = json.loads(metadata[_KEY])
        version = header.pop("version")
    except (KeyError, ValueError, AttributeError) as error:
        raise DeepringError(f"index {path}: no header of ours ({error})") from error
    if version != FORMAT_VERSION:
        raise DeepringError(
            f"index {path}: format version {version!r}, expected {FORMAT_VERSION}; write it again "
            "with this version of deepring"
        )
    return tensors, header


def read_shards(folder: Path, lengths: list[int]) -> list[Block]:
    """The blocks, memory-mapped."""
    blocks = []
    for number, length in enumerate(lengths):
        path = folder / f"{number:05d}.safetensors"
        block, _ = _read(path)
        found = lengths_of(block)
        if found != {length}:
            raise DeepringError(f"index {path}: holds {sorted(found)} rows, expected {length}")
        blocks.append(block)
    return blocks


def _read(path: Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    try:
        with safe_open(path, framework="pt") as file:
            names = sorted(file.keys())
            return {name: file.get_tensor(name) for name in names}, file.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise DeepringError(
            f"index {path}: {error}; expected a file written by save; this one is missing, was "
            "cut short or altered: copy the whole folder again, or build it again"
        ) from error
