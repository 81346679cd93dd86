"""The order of calls that threads bring in any order."""

import random

from hypothesis import given
from hypothesis import strategies as st

from quadctl.services.foxglove.calls import PATIENCE, CallOrder


def drained(order: CallOrder[str], now: float) -> list[str]:
    found = []
    while (item := order.next(now)) is not None:
        found.append(item)
    return found


def test_the_first_call_waits_for_one_with_a_lower_id():
    order: CallOrder[str] = CallOrder()
    order.add(1, 6, "second", 0.0)
    assert order.next(0.0) is None
    assert order.due() == PATIENCE
    order.add(1, 5, "first", PATIENCE / 2)
    assert drained(order, 2 * PATIENCE) == ["first", "second"]
    assert (len(order), order.due()) == (0, None)


def test_a_call_that_follows_the_last_one_does_not_wait():
    order: CallOrder[str] = CallOrder()
    order.add(1, 1, "first", 0.0)
    assert drained(order, PATIENCE) == ["first"]
    order.add(1, 3, "third", 1.0)
    assert order.next(1.0) is None
    order.add(1, 2, "second", 1.01)
    assert drained(order, 1.01) == ["second", "third"]


def test_a_missing_call_holds_up_the_next_one_for_a_moment_only():
    order: CallOrder[str] = CallOrder()
    order.add(1, 1, "first", 0.0)
    drained(order, PATIENCE)
    order.add(1, 9, "ninth", 1.0)
    assert order.next(1.0 + PATIENCE / 2) is None
    assert order.next(1.0 + PATIENCE) == "ninth"


def test_a_call_that_is_too_late_for_its_turn_is_not_held_up():
    order: CallOrder[str] = CallOrder()
    order.add(1, 2, "second", 0.0)
    assert order.next(PATIENCE) == "second"
    order.add(1, 1, "first", 1.0)
    assert order.next(1.0) == "first"


def test_clients_do_not_wait_for_each_other():
    order: CallOrder[str] = CallOrder()
    order.add(1, 1, "one", 0.0)
    drained(order, PATIENCE)
    order.add(2, 7, "other", 1.0)
    order.add(1, 2, "one again", 1.01)
    assert drained(order, 1.01) == ["one again"]
    assert drained(order, 1.0 + PATIENCE) == ["other"]


@given(st.integers(1, 30), st.integers(0, 1000), st.randoms())
def test_calls_that_come_within_the_patience_leave_in_order(
    count: int, start: int, noise: random.Random
):
    order: CallOrder[int] = CallOrder()
    numbers = list(range(start, start + count))
    noise.shuffle(numbers)
    found = []
    for place, number in enumerate(numbers):
        now = place * PATIENCE / 100
        order.add(1, number, number, now)
        if (item := order.next(now)) is not None:
            found.append(item)
    while len(order):
        item = order.next(1.0)
        assert item is not None
        found.append(item)
    assert found == sorted(numbers)


def test_the_next_time_is_that_of_a_call_whose_turn_it_is():
    order: CallOrder[str] = CallOrder()
    order.add(1, 2, "second", 0.0)
    order.add(1, 1, "first", 0.01)
    assert order.due() == 0.01 + PATIENCE
    assert drained(order, 0.01 + PATIENCE) == ["first", "second"]
