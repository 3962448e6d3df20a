"""Named tensors of one length, in blocks, that rows are added to without copying the others."""

from collections.abc import Iterator, Mapping

import torch
from jaxtyping import Int64, Shaped
from torch import Tensor

from deepring.errors import DataError

#: Rows after which a block is closed; what is in a closed block is never copied again.
BLOCK = 65_536

#: Names of tensors whose rows lie along the last axis, so that one instruction compares many of
#: them; those of all others lie along the first.
LYING = frozenset({"code"})

Block = dict[str, Tensor]


def axis_of(name: str) -> int:
    """The axis along which the rows of a tensor of this name lie."""
    return -1 if name in LYING else 0


def lengths_of(block: Mapping[str, Tensor]) -> set[int]:
    """How many rows the tensors of a block have: one number, if all is well."""
    return {value.shape[axis_of(name)] for name, value in block.items()}


class BlockStore:
    """Blocks of rows. The last one grows by doubling; those before may be memory-mapped files."""

    def __init__(self) -> None:
        self._closed: list[Block] = []
        self._tail: Block = {}
        self._used = 0

    def __len__(self) -> int:
        return sum(_length(block) for block in self._closed) + self._used

    def attach(self, block: Block) -> None:
        """Take a whole block as it is, without a copy. What was added before comes first."""
        self._close()
        self._closed.append(block)

    def add(self, rows: Mapping[str, Tensor]) -> None:
        """Copy rows to the end."""
        count = _length(rows)
        if self._tail and self._used + count > BLOCK:
            self._close()
        needed = self._used + count
        if not self._tail or needed > _length(self._tail):
            self._tail = {
                name: _grown(
                    self._tail.get(name), value, max(needed, 2 * self._used), axis_of(name)
                )
                for name, value in rows.items()
            }
        for name, value in rows.items():
            _rows(self._tail[name], self._used, count, name).copy_(value)
        self._used = needed

    def blocks(self) -> list[Block]:
        """All blocks in order, without copies."""
        return [*self._closed, *([self._open()] if self._used else [])]

    def chunks(self, size: int, *names: str) -> Iterator[tuple[int, list[Tensor]]]:
        """Runs of at most ``size`` rows of the named tensors, with the number of the first row."""
        start = 0
        for block in self.blocks():
            length = _length(block)
            for first in range(0, length, size):
                count = min(size, length - first)
                yield start + first, [_rows(block[name], first, count, name) for name in names]
            start += length

    def whole(self, name: str) -> Iterator[tuple[int, Tensor]]:
        """The tensors of a name as they lie in memory, each with the number of its rows in use.

        Behind those there may be room that rows are yet to be added to.
        """
        for block in self._closed:
            yield _length(block), block[name]
        if self._used:
            yield self._used, self._tail[name]

    def take(self, numbers: Int64[Tensor, " n"], *names: str) -> list[Shaped[Tensor, "n ..."]]:
        """Rows by their numbers (n,), in that order, of tensors whose rows come first."""
        blocks = self.blocks()
        ends = torch.tensor([_length(block) for block in blocks]).cumsum(0)
        owner = torch.bucketize(numbers.cpu(), ends, right=True)
        taken = []
        for name in names:
            first = blocks[0][name]
            out = first.new_empty(len(numbers), *first.shape[1:])
            for which in sorted(set(owner.tolist())):
                mine = owner == which
                start = int(ends[which - 1]) if which else 0
                out[mine] = blocks[which][name][numbers[mine] - start]
            taken.append(out)
        return taken

    def _open(self) -> Block:
        return {name: _rows(value, 0, self._used, name) for name, value in self._tail.items()}

    def _close(self) -> None:
        if self._used:
            self._closed.append(self._open())
        self._tail, self._used = {}, 0


def _rows(tensor: Tensor, first: int, count: int, name: str) -> Tensor:
    return tensor.narrow(axis_of(name), first, count)


def _length(rows: Mapping[str, Tensor]) -> int:
    lengths = lengths_of(rows)
    if len(lengths) != 1:
        raise DataError(f"rows: tensors of {sorted(lengths)} rows, expected one length")
    return lengths.pop()


def _grown(old: Tensor | None, like: Tensor, capacity: int, axis: int) -> Tensor:
    shape = list(like.shape)
    shape[axis] = capacity
    grown = like.new_empty(shape)
    if old is not None:
        grown.narrow(axis, 0, old.shape[axis]).copy_(old)
    return grown
