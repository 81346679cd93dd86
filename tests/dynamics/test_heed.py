"""Which setpoints move the vehicle."""

from schemas.messages import Position
from services.dynamics.simulation import GoalLatch

THERE, ELSEWHERE = Position(3.0, 0.0, 1.0), Position(0.0, 3.0, 1.0)


def stopped_on_its_way() -> GoalLatch:
    heed = GoalLatch()
    assert heed.heeds(THERE, brake=False)
    heed.stopped()
    return heed


def test_after_a_stop_of_its_own_it_does_not_go_on_to_the_goal_that_it_had():
    heed = stopped_on_its_way()
    assert not heed.heeds(THERE, brake=False)
    assert not heed.heeds(Position(3.0, 0.0, 1.0), brake=False)


def test_within_the_grace_it_goes_on():
    heed = stopped_on_its_way()
    heed.resumed()
    assert heed.heeds(THERE, brake=False)


def test_another_goal_was_asked_for_since():
    heed = stopped_on_its_way()
    assert heed.heeds(ELSEWHERE, brake=False)
    assert heed.heeds(THERE, brake=False)


def test_a_safety_that_knows_of_the_stop_may_send_it_there_again():
    heed = stopped_on_its_way()
    assert heed.heeds(THERE, brake=True)
    assert heed.heeds(THERE, brake=False)


def test_silence_in_which_it_had_no_goal_bars_none():
    heed = GoalLatch()
    heed.stopped()
    assert heed.heeds(THERE, brake=False)
    assert heed.heeds(THERE, brake=True)
    heed.stopped()
    assert heed.heeds(THERE, brake=False)
