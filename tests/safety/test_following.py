"""Whether the vehicle follows what it is told, as its poses show."""

from math import inf

from msgspec.structs import replace

from quadctl.schemas.messages import Position, Velocity
from quadctl.services.safety.monitor import PATIENCE, STANDS, TrackingMonitor
from tests.safety.worlds import POSE

LIMIT, PERIOD = 0.15, 0.05
GOAL, OTHER = Position(3.0, 0.0, 1.0), Position(0.0, 3.0, 1.0)
STILL = Velocity(0.0, 0.0, 0.0)


def look(
    following: TrackingMonitor,
    stamp: float,
    goal: Position | None = GOAL,
    *,
    boot: str = "b1",
    velocity: Velocity = POSE.velocity,
    moving: bool = True,
) -> str:
    pose = replace(POSE, boot=boot, stamp=stamp, velocity=velocity)
    gap, stands = following.observe(pose, goal, moving=moving)
    return STANDS if stands else f"{gap:.2g} s" if gap > LIMIT else ""


def test_poses_that_come_in_time_are_no_trouble():
    following = TrackingMonitor()
    assert [look(following, count * PERIOD) for count in range(100)] == [""] * 100


def test_poses_that_come_late_show_a_vehicle_that_heard_nothing():
    following = TrackingMonitor()
    look(following, 1.0)
    assert look(following, 1.0 + LIMIT - 0.01) == ""
    assert look(following, 1.5) == "0.36 s"
    assert look(following, 1.55) == ""


def test_a_goal_that_is_new_since_was_not_stopped_on_the_way_to():
    following = TrackingMonitor()
    look(following, 1.0, None)
    assert look(following, 2.0) == ""
    assert look(following, 3.0, OTHER) == ""
    assert look(following, 4.0, None) == ""
    assert look(following, 5.0, None) == ""


def test_another_boot_is_another_time():
    following = TrackingMonitor()
    look(following, 1.0)
    assert look(following, 9.0, boot="b2") == ""


def test_a_simulation_that_was_held_up_itself_has_not_flown_on():
    following = TrackingMonitor()
    look(following, 1.0)
    assert [look(following, 1.0) for _ in range(20)] == [""] * 20
    assert look(following, 1.05) == ""


def test_a_vehicle_that_stands_still_on_its_way_does_not_follow():
    following = TrackingMonitor()
    at = [count * PERIOD for count in range(round(PATIENCE / PERIOD) + 3)]
    said = [look(following, stamp, velocity=STILL) for stamp in at]
    assert said == [*[""] * (len(at) - 1), "the vehicle stood still for 1 s on its way"]


def test_a_goal_that_is_new_is_given_its_time():
    following = TrackingMonitor()
    for count in range(100):
        goal = Position(1.0, 0.0, count // 19)
        assert look(following, count * PERIOD, goal, velocity=STILL) == ""


def test_standing_still_is_counted_anew_after_each_move_and_only_on_the_way():
    following = TrackingMonitor()
    for count in range(200):
        still = STILL if count % 20 else POSE.velocity
        assert look(following, count * PERIOD, velocity=still) == ""
    for count in range(200, 300):
        assert look(following, count * PERIOD, velocity=STILL, moving=False) == ""
        assert following.due == inf
