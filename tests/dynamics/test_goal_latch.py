"""Which setpoints move the vehicle."""

from quadctl.schemas.messages import Position
from quadctl.services.dynamics.simulation import GoalLatch

THERE, ELSEWHERE = Position(3.0, 0.0, 1.0), Position(0.0, 3.0, 1.0)


def stopped_on_its_way() -> GoalLatch:
    latch = GoalLatch()
    assert latch.accepts(THERE, brake=False)
    latch.stopped()
    return latch


def test_after_a_stop_of_its_own_it_does_not_go_on_to_the_goal_that_it_had():
    latch = stopped_on_its_way()
    assert not latch.accepts(THERE, brake=False)
    assert not latch.accepts(Position(3.0, 0.0, 1.0), brake=False)


def test_within_the_grace_it_goes_on():
    latch = stopped_on_its_way()
    latch.resumed()
    assert latch.accepts(THERE, brake=False)


def test_another_goal_was_asked_for_since():
    latch = stopped_on_its_way()
    assert latch.accepts(ELSEWHERE, brake=False)
    assert latch.accepts(THERE, brake=False)


def test_a_safety_that_knows_of_the_stop_may_send_it_there_again():
    latch = stopped_on_its_way()
    assert latch.accepts(THERE, brake=True)
    assert latch.accepts(THERE, brake=False)


def test_silence_in_which_it_had_no_goal_bars_none():
    latch = GoalLatch()
    latch.stopped()
    assert latch.accepts(THERE, brake=False)
    assert latch.accepts(THERE, brake=True)
    latch.stopped()
    assert latch.accepts(THERE, brake=False)
