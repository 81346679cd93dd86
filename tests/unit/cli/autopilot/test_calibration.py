"""What a calibration measures of a flight whose numbers are known."""

import pytest

from quadctl.cli.autopilot.calibration import Measured, _measure_flight
from quadctl.schemas.messages import BodyRates, Pose, Position, Quaternion, Velocity
from quadctl.services.runtime.errors import Refused

STEP, LEVEL, STILL = 0.02, Quaternion(1, 0, 0, 0), BodyRates(0, 0, 0)
GOAL = Position(2, 0, 1)


def track() -> list[tuple[float, Pose]]:
    """Return 50 Hz poses of 1 s at 1 m/s^2, 1 s at 1 m/s, and 1 s of braking, 10 mm beside a straight way."""
    found = []
    for number in range(151):
        t = number * STEP
        speed = min(t, 1.0, max(3.0 - t, 0.0))
        x = t * t / 2 if t < 1 else t - 0.5 if t < 2 else 2 - (3 - t) ** 2 / 2
        pose = Pose(
            "b0", number, t, Position(x, 0.01, 1), Velocity(speed, 0, 0), LEVEL, STILL
        )  # fmt: skip
        found.append((t, pose))
    return found


def test_rate_gap_speed_and_strays_are_those_of_the_flight():
    m = Measured()
    poses = [*track(), (4.0, track()[-1][1])]
    approaches = _measure_flight(m, Position(0, 0, 1), GOAL, poses)
    assert m.rate == pytest.approx(151 / 4.0)
    assert m.gap == pytest.approx(1.0)
    assert m.speed == pytest.approx(1.0)
    assert m.acceleration == pytest.approx(1.0, rel=1e-6)
    assert m.stray == pytest.approx(0.01)
    assert m.overshoot == pytest.approx(0.0, abs=1e-9)
    # Half a metre before the goal it flies at 1 m/s: it needs 1 m/s^2 to stop there, less with some room.
    assert 0.8 < m.approach < 1.0
    assert [left for speed, left in approaches if speed == 1.0] == pytest.approx(
        [1.5 - number * STEP for number in range(51)], abs=0.02
    )


def test_a_flight_without_poses_is_refused():
    with pytest.raises(Refused, match="no poses came"):
        _measure_flight(Measured(), Position(0, 0, 1), GOAL, track()[:1])
