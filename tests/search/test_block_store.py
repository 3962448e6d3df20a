"""Growing blocks of rows: as one tensor, whatever was added when."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from deepring.errors import DataError, DeepringError
from deepring.search import block_store as rows_module
from deepring.search.block_store import BlockStore
from deepring.search.hits import Best


@given(st.lists(st.integers(0, 9), min_size=1, max_size=12), st.integers(1, 6), st.integers(0, 3))
def test_rows_are_those_that_were_added(counts, size, attached):
    rows, parts, total = BlockStore(), [], 0
    for number, count in enumerate(counts):
        part = torch.arange(total, total + count).float()[:, None] * torch.tensor([1.0, -1.0])
        named = {"a": part, "b": part[:, 0].long(), "code": part.T.contiguous()}
        if number == attached and count:
            rows.attach(named)
        else:
            rows.add(named)
        parts.append(part)
        total += count
    expected = torch.cat(parts)
    assert len(rows) == total
    seen = [(start, *chunk) for start, chunk in rows.chunks(size, "a", "b")]
    assert [start for start, *_ in seen] == [
        sum(len(a) for _, a, _ in seen[:k]) for k in range(len(seen))
    ]
    assert all(1 <= len(a) <= size for _, a, _ in seen)
    if total:
        assert torch.equal(torch.cat([a for _, a, _ in seen]), expected)
        lying = torch.cat([code[..., :used] for used, code in rows.whole("code")], dim=-1)
        assert torch.equal(lying, expected.T)
        assert torch.equal(torch.cat([c for _, (c,) in rows.chunks(size, "code")], dim=-1), lying)
        some = torch.randperm(total)[: total // 2 + 1]
        a, b = rows.take(some, "a", "b")
        assert torch.equal(a, expected[some])
        assert torch.equal(b, some)


def test_closed_blocks_are_not_copied_again(monkeypatch):
    monkeypatch.setattr(rows_module, "BLOCK", 8)
    rows = BlockStore()
    rows.add({"a": torch.arange(6)})
    first = rows.blocks()[0]["a"].data_ptr()
    for k in range(6, 40):
        rows.add({"a": torch.tensor([k])})
    assert rows.blocks()[0]["a"].data_ptr() in (first, rows.blocks()[0]["a"].data_ptr())
    assert [len(block["a"]) for block in rows.blocks()] == [8, 8, 8, 8, 8]
    assert torch.cat([block["a"] for block in rows.blocks()]).tolist() == list(range(40))


def test_columns_of_different_lengths_are_refused():
    with pytest.raises(DeepringError, match=r"\[2, 3\] rows"):
        BlockStore().add({"a": torch.zeros(2), "b": torch.zeros(3)})


@given(st.lists(st.integers(0, 3), min_size=1, max_size=30), st.integers(1, 5), st.integers(1, 7))
def test_the_best_are_those_of_one_stable_sort(scores, k, chunk):
    values = torch.tensor(scores, dtype=torch.float32)
    order = values.argsort(descending=True, stable=True)[:k]
    best = Best(1, k)
    for start in range(0, len(values), chunk):
        part = values[start : start + chunk]
        best.update(part[None], torch.arange(start, start + len(part)))
    assert torch.equal(best.score[0], values[order])
    assert best.place.shape == (1, len(order))


def test_one_tensor_is_replaced_until_a_block_is_closed():
    store = BlockStore()
    store.add({"a": torch.arange(3), "b": torch.arange(3)})
    mark = store.mark()
    store.replace("a", torch.arange(3) + 10)
    store.add({"a": torch.tensor([7]), "b": torch.tensor([8])})
    (block,) = store.blocks()
    assert block["a"].tolist() == [10, 11, 12, 7]
    assert block["b"].tolist() == [0, 1, 2, 8]
    store.rewind(mark)
    assert store.blocks()[0]["a"].tolist() == [0, 1, 2]
    store.attach({"a": torch.arange(1), "b": torch.arange(1)})
    with pytest.raises(DataError, match="closed"):
        store.replace("a", torch.arange(4))
