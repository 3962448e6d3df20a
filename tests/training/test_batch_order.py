"""The order of batches: processes share an epoch, and it begins again where it is set."""

from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.training.batch_order import BatchOrder


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 9), st.integers(1, 4), st.integers(1, 4))
def test_ranks_share_the_episodes_without_overlap_or_gap(per_epoch, world_size, epochs):
    orders = [BatchOrder(per_epoch, rank, world_size) for rank in range(world_size)]
    assert len({len(order) for order in orders}) == 1  # or the ranks would wait for each other
    taken = []
    for epoch in range(epochs):
        for order in orders:
            order.set_epoch(epoch)
            numbers = list(order)
            assert len(numbers) == len(order)
            taken += numbers
    assert sorted(taken) == list(range(len(taken)))
    assert 0 <= len(taken) - epochs * per_epoch < epochs * world_size


def test_two_ranks_draw_together_what_one_draws_alone():
    alone = list(BatchOrder(6))
    halves = [list(BatchOrder(6, rank, 2)) for rank in range(2)]
    assert sorted(halves[0] + halves[1]) == alone
    assert not set(halves[0]) & set(halves[1])


def test_an_epoch_begins_again_where_it_is_set():
    order = BatchOrder(3)
    order.set_epoch(2)
    assert list(order) == list(order) == [6, 7, 8]
