"""Blocks of rows as files: a folder of sealed shards, memory-mapped when opened.

A folder grows by further shards; earlier ones are neither rewritten nor read. ``index.safetensors``
holds the values that all rows share. It is written last, so that after an interrupted write the
folder opens in its previous state.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from deepring.checks import count
from deepring.errors import DataError, FileError
from deepring.io.sealed import SealedFormat, open_sealed, write_sealed
from deepring.io.tensor_types import TensorType, dtype_of
from deepring.search.block_store import Block, axis_of, lengths_of
from deepring.search.code import Code
from deepring.search.spectra import LANES, TAIL_STEP, Precision

#: The file of the values that all rows share.
INDEX = "index.safetensors"

#: Tensors of n places; see `deepring.search.spectra.Spectra` and `deepring.search.code.Code`.
ROWS = {
    "values": TensorType(("float32", "bfloat16", "int8"), ("n", "k", 2, "w"), large=True),
    "scale": TensorType("float32", ("n", "k"), least=0),
    "tails": TensorType("float32", ("n", "c"), least=0),
    "code": TensorType("int8", ("frequencies", "components", 2, "n"), optional=True),
}


@dataclass(frozen=True)
class Shard:
    """The index's entry of one shard."""

    rows: int
    digest: str
    """Digest of the file, see `deepring.io.sealed.Sealed`."""

    def __post_init__(self) -> None:
        count("shards.rows", self.rows)


@dataclass(frozen=True)
class _ShardHeader:
    """The header of a shard file."""

    number: int


SHARD = SealedFormat(
    "index shard",
    1,
    _ShardHeader,
    ROWS,
    description="a shard as CorrelationIndex.save writes it",
    remedy="copy the whole folder again, or build the index again",
)


def write_shard(folder: Path, number: int, block: Block) -> Shard:
    """Write one block, completely or not at all."""
    digest = write_sealed(_path(folder, number), SHARD, _ShardHeader(number), block)
    return Shard(lengths_of(block).pop(), digest)


def read_shards(folder: Path, shards: Sequence[Shard], *, check: bool = False) -> list[Block]:
    """Memory-map the blocks; ``check`` reads and verifies every byte.

    Raises FileError for a shard that is missing, damaged, or not part of this index.
    """
    blocks = []
    for number, shard in enumerate(shards):
        path = _path(folder, number)
        file = open_sealed(path, SHARD, check=check)
        rows = lengths_of(file.tensors)
        if file.digest != shard.digest or file.header.number != number or rows != {shard.rows}:
            raise FileError(
                f"index shard {path}: from another index or position, expected shard {number} "
                f"with {shard.rows} rows; {SHARD.remedy}"
            )
        blocks.append(file.tensors)
    return blocks


def expect_block(
    block: Block, shape: tuple[int, int], precision: Precision, code: Code | None
) -> None:
    """Raise DataError unless a block holds descriptors of ``shape`` (θ, ω)."""
    rows, columns = shape
    frequencies = rows // 2 + 1
    row_shapes: dict[str, tuple[int, ...]] = {
        "values": (frequencies, 2, columns + -columns % LANES),
        "scale": (frequencies,),
        "tails": (len(range(TAIL_STEP, frequencies, TAIL_STEP)),),
    }
    if code is not None:
        row_shapes["code"] = (*code.step.shape, 2)
    shapes = {name: tuple(row.movedim(axis_of(name), 0).shape[1:]) for name, row in block.items()}
    if shapes != row_shapes or dtype_of(block["values"]) != precision:
        raise DataError(
            f"rows: shapes {shapes}; expected {precision} values in rows of {row_shapes}, for "
            f"descriptors of {rows} x {columns}"
        )


def _path(folder: Path, number: int) -> Path:
    return folder / f"{number:05d}.safetensors"
