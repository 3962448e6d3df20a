"""Named tensors of one length, in blocks, that rows are added to without copying the others."""

from collections.abc import Iterator, Mapping

import torch
from torch import Tensor

from deepring.errors import DeepringError

#: Rows after which a block is closed; what is in a closed block is never copied again.
BLOCK = 65_536

Block = dict[str, Tensor]


class Rows:
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
                name: _grown(self._tail.get(name), value, max(needed, 2 * self._used))
                for name, value in rows.items()
            }
        for name, value in rows.items():
            self._tail[name][self._used : needed] = value
        self._used = needed

    def blocks(self) -> list[Block]:
        """All blocks in order, without copies."""
        return [*self._closed, *([self._open()] if self._used else [])]

    def chunks(self, size: int, *names: str) -> Iterator[tuple[int, list[Tensor]]]:
        """Runs of at most ``size`` rows of the tensors asked for, with the number of the first."""
        start = 0
        for block in self.blocks():
            length = _length(block)
            for first in range(0, length, size):
                yield start + first, [block[name][first : first + size] for name in names]
            start += length

    def take(self, numbers: Tensor, *names: str) -> list[Tensor]:
        """Rows by their numbers (n,), in that order."""
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
        return {name: value[: self._used] for name, value in self._tail.items()}

    def _close(self) -> None:
        if self._used:
            self._closed.append(self._open())
        self._tail, self._used = {}, 0


def _length(rows: Mapping[str, Tensor]) -> int:
    lengths = {len(value) for value in rows.values()}
    if len(lengths) != 1:
        raise DeepringError(f"rows: tensors of {sorted(lengths)} rows, expected one length")
    return lengths.pop()


def _grown(old: Tensor | None, like: Tensor, capacity: int) -> Tensor:
    grown = like.new_empty(capacity, *like.shape[1:])
    if old is not None:
        grown[: len(old)] = old
    return grown
