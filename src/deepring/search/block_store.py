"""Named tensors of one length, in blocks, so that adding rows does not copy all others."""

from collections.abc import Iterator, Mapping

import torch
from jaxtyping import Int64, Shaped
from torch import Tensor

from deepring.errors import DataError

#: Rows after which a block is closed; closed blocks are never copied again.
BLOCK = 65_536

#: Tensors with rows along the last axis, so that one instruction compares many of them; the rows of
#: all others are along the first.
ROWS_LAST = frozenset({"code"})

Block = dict[str, Tensor]


def axis_of(name: str) -> int:
    """The axis of the rows of the tensor ``name``."""
    return -1 if name in ROWS_LAST else 0


def lengths_of(block: Mapping[str, Tensor]) -> set[int]:
    """The numbers of rows of a block's tensors: a single one in a valid block."""
    return {value.shape[axis_of(name)] for name, value in block.items()}


class BlockStore:
    """Blocks of rows. The last one grows by doubling; earlier ones may be memory-mapped files."""

    def __init__(self) -> None:
        self._closed: list[Block] = []
        self._tail: Block = {}
        self._tail_rows = 0  # of these in use

    def __len__(self) -> int:
        return sum(_length(block) for block in self._closed) + self._tail_rows

    def attach(self, block: Block) -> None:
        """Append a whole block without copying it."""
        self._close()
        self._closed.append(block)

    def add(self, rows: Mapping[str, Tensor]) -> None:
        """Copy rows to the end."""
        count = _length(rows)
        if self._tail and self._tail_rows + count > BLOCK:
            self._close()
        total = self._tail_rows + count
        if not self._tail or total > _length(self._tail):
            self._tail = {
                name: _with_capacity(
                    self._tail.get(name), value, max(total, 2 * self._tail_rows), axis_of(name)
                )
                for name, value in rows.items()
            }
        for name, value in rows.items():
            _rows(self._tail[name], self._tail_rows, count, name).copy_(value)
        self._tail_rows = total

    def replace(self, name: str, rows: Shaped[Tensor, "..."]) -> None:
        """Put other rows in the place of all of one tensor. Only where no block is closed."""
        if self._closed:
            raise DataError(f"rows: {name} of {len(self._closed)} closed blocks, expected none")
        # A new tail, since `mark` may hold the old one.
        capacity = _length(self._tail)
        self._tail = self._tail | {name: _with_capacity(rows, rows, capacity, axis_of(name))}

    def mark(self) -> tuple[list[Block], Block, int]:
        """The present rows, to which `rewind` goes back."""
        return list(self._closed), self._tail, self._tail_rows

    def rewind(self, mark: tuple[list[Block], Block, int]) -> None:
        """Drop the rows added since `mark`."""
        closed, self._tail, self._tail_rows = mark
        self._closed = list(closed)

    def blocks(self) -> list[Block]:
        """All blocks in order, without copies."""
        return [*self._closed, *([self._open()] if self._tail_rows else [])]

    def chunks(self, size: int, *names: str) -> Iterator[tuple[int, list[Tensor]]]:
        """Chunks of at most ``size`` rows of the named tensors, with the number of the first."""
        start = 0
        for block in self.blocks():
            length = _length(block)
            for first in range(0, length, size):
                count = min(size, length - first)
                yield start + first, [_rows(block[name], first, count, name) for name in names]
            start += length

    def whole(self, name: str) -> Iterator[tuple[int, Tensor]]:
        """The blocks of one tensor without copies, each with the number of its rows in use.

        The last block may have spare rows after those.
        """
        for block in self._closed:
            yield _length(block), block[name]
        if self._tail_rows:
            yield self._tail_rows, self._tail[name]

    def take(self, numbers: Int64[Tensor, " n"], *names: str) -> list[Shaped[Tensor, "n ..."]]:
        """Rows by their numbers (n,), in that order, of tensors with rows along the first axis."""
        blocks = self.blocks()
        ends = torch.tensor([_length(block) for block in blocks]).cumsum(0)
        owner = torch.bucketize(numbers.cpu(), ends, right=True)
        rows = []
        for name in names:
            first = blocks[0][name]
            out = first.new_empty(len(numbers), *first.shape[1:])
            for which in sorted(set(owner.tolist())):
                mask = owner == which
                start = int(ends[which - 1]) if which else 0
                out[mask] = blocks[which][name][numbers[mask] - start]
            rows.append(out)
        return rows

    def _open(self) -> Block:
        return {name: _rows(value, 0, self._tail_rows, name) for name, value in self._tail.items()}

    def _close(self) -> None:
        if self._tail_rows:
            self._closed.append(self._open())
        self._tail, self._tail_rows = {}, 0


def _rows(tensor: Tensor, first: int, count: int, name: str) -> Tensor:
    return tensor.narrow(axis_of(name), first, count)


def _length(rows: Mapping[str, Tensor]) -> int:
    lengths = lengths_of(rows)
    if len(lengths) != 1:
        raise DataError(f"rows: tensors of {sorted(lengths)} rows, expected one length")
    return lengths.pop()


def _with_capacity(old: Tensor | None, like: Tensor, capacity: int, axis: int) -> Tensor:
    shape = list(like.shape)
    shape[axis] = capacity
    new = like.new_empty(shape)
    if old is not None:
        new.narrow(axis, 0, old.shape[axis]).copy_(old)
    return new
