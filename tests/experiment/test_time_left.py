"""The time that a sweep still takes: by jobs of the same kind, by epochs, and side by side."""

import pytest

from deepring.experiment.time_left import JobTime, time_left

A, B = (("part", "ring"), "a"), (("part", "ring"), "b")
OTHER = (("part", "deepring"), "a")


def waiting(kind, count=1):
    return [JobTime(kind)] * count


def test_jobs_one_after_the_other_take_as_long_as_those_of_their_kind():
    done = [JobTime(A, took=100), JobTime(A, took=120), JobTime(B, took=1000)]
    assert time_left(done, [], waiting(A, 3), 1) == (330, 0)
    assert time_left(done, [], waiting(B), 1) == (1000, 0)


def test_another_kind_of_the_same_method_takes_the_mean_of_kinds_not_of_jobs():
    done = [JobTime(A, took=100)] * 9 + [JobTime(B, took=300)]
    further = (("part", "ring"), "c")
    assert time_left(done, [], waiting(further), 1) == (200, 0)


def test_quick_methods_say_nothing_of_slow_ones():
    done = [JobTime(A, took=2)]
    assert time_left(done, [], waiting(A) + waiting(OTHER, 3), 1) == (2, 3)
    assert time_left([], [], waiting(A, 4), 1) == (0, 4)


def test_a_running_job_tells_its_own_time_by_its_epochs_and_that_of_its_kind():
    running = [JobTime(A, elapsed=30, share=0.25)]
    assert time_left([], running, [], 1) == (90, 0)
    assert time_left([], running, waiting(A, 2), 1) == (90 + 240, 0)
    begun = [JobTime(A, elapsed=30, share=0.01)]  # the first batches tell little
    assert time_left([], begun, [], 1) == (0, 1)
    assert time_left([JobTime(A, took=100)], begun, [], 1) == (70, 0)


def test_what_is_slower_than_before_takes_what_its_epochs_say():
    slow = [JobTime(A, elapsed=100, share=0.25)]
    assert time_left([JobTime(A, took=120)], slow, [], 1) == (300, 0)


def test_what_is_overdue_is_not_said_to_be_done():
    late = [JobTime(A, elapsed=200)]
    assert time_left([JobTime(A, took=100)], late, [], 1).seconds == pytest.approx(10)


def test_jobs_beside_each_other_end_with_the_last():
    done = [JobTime(A, took=100)]
    assert time_left(done, [], waiting(A, 5), 2) == (300, 0)
    running = [JobTime(A, elapsed=90), JobTime(A, elapsed=20)]
    assert time_left(done, running, waiting(A), 2) == (110, 0)
    assert time_left(done, running, waiting(A), None) == (110, 0), "as many as run now"
    assert time_left(done, [], [], 4) == (0, 0)
