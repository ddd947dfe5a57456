"""The numbers that make steps happen exactly once."""

from __future__ import annotations

import numpy as np
import pytest
from b4mrl.errors import BusyError, FailedPreconditionError, InvalidArgumentError
from b4mrl.wire.lane_numbers import LaneNumbers


def lanes(*numbers: int) -> np.ndarray:
    return np.array(numbers, np.uint32)


def begin(numbers: LaneNumbers, chosen: np.ndarray | None) -> np.ndarray:
    given = numbers.next_of(chosen)
    numbers.begin(chosen)
    return given


def test_each_lane_counts_its_own_executed_operations() -> None:
    numbers = LaneNumbers(3)
    first = begin(numbers, None)
    assert first.tolist() == [1, 1, 1]
    numbers.end(None, first, executed=True)
    second = begin(numbers, lanes(2, 0))
    assert second.tolist() == [2, 2]
    numbers.end(lanes(2, 0), second, executed=True)
    assert begin(numbers, None).tolist() == [3, 2, 3]


def test_ending_an_operation_twice_is_ending_it_once() -> None:
    numbers = LaneNumbers(1)
    first = begin(numbers, None)
    numbers.end(None, first, executed=True)
    numbers.end(None, first, executed=True)
    assert begin(numbers, None).tolist() == [2]


def test_a_refused_operation_gives_its_number_back() -> None:
    numbers = LaneNumbers(1)
    numbers.end(None, begin(numbers, None), executed=False)
    assert begin(numbers, None).tolist() == [1]


def test_a_lane_under_way_is_busy_and_the_others_stay_free() -> None:
    numbers = LaneNumbers(3)
    begin(numbers, lanes(1))
    with pytest.raises(BusyError, match="lane 1 .*call recv first"):
        numbers.next_of(lanes(0, 1))
    assert begin(numbers, lanes(0, 2)).tolist() == [1, 1]


def test_a_number_that_may_be_taken_is_not_used_again() -> None:
    numbers = LaneNumbers(2)
    numbers.end(lanes(1), begin(numbers, lanes(1)), executed=None)
    with pytest.raises(FailedPreconditionError, match="lane 1"):
        numbers.next_of(None)
    assert begin(numbers, lanes(0)).tolist() == [1]


@pytest.mark.parametrize("wrong", [lanes(), lanes(3), lanes(1, 1)])
def test_lanes_that_cannot_be_are_refused(wrong: np.ndarray) -> None:
    with pytest.raises(InvalidArgumentError):
        LaneNumbers(3).next_of(wrong)


def test_a_session_for_queries_has_no_lanes() -> None:
    with pytest.raises(FailedPreconditionError):
        LaneNumbers(0).next_of(None)


def test_an_operation_of_all_lanes_makes_each_of_them_busy_or_lost() -> None:
    numbers = LaneNumbers(3)
    first = begin(numbers, None)
    with pytest.raises(BusyError, match="lane 2"):
        numbers.next_of(lanes(2))
    numbers.end(None, first, executed=None)
    with pytest.raises(FailedPreconditionError, match="lane 1"):
        numbers.next_of(lanes(1))
