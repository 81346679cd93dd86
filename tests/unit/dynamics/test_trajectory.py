"""Setpoint generator: time-optimal, within its limits, smooth, straight, no overshoot."""

import random
from collections.abc import Iterator
from itertools import pairwise
from math import ceil, dist, hypot, sqrt

import pytest
from hypothesis import assume, example, given, settings, strategies as st

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics import trajectory as generator
from quadctl.services.dynamics.controller import PERIOD
from quadctl.services.dynamics.trajectory import Motion, advance_axis, decelerate, stop
from quadctl.services.dynamics.vehicle import Vehicle
from tests.support.setpoint_path import Path

SIZE = (5.0, 5.0, 2.0)
AXIS = st.sampled_from([-1.0, 0.0, 1.0]) | st.floats(-1.0, 1.0)
HEIGHT = st.sampled_from([0.0, 1.0]) | st.floats(0.0, 1.0)
GOAL = st.tuples(AXIS.map(lambda n: 5 * n), AXIS.map(lambda n: 5 * n), HEIGHT.map(lambda n: 2 * n))

WEST, EAST = (-5.0, -5.0, 0.0), (5.0, -5.0, 0.0)


def excursion(position):
    """Return the distance of a point outside the cage (m), negative inside."""
    x, y, z = position
    return max(abs(x) - SIZE[0], abs(y) - SIZE[1], z - SIZE[2], -z)


@settings(max_examples=40)
@given(st.lists(st.tuples(GOAL, st.integers(1, 400)), min_size=2, max_size=8))
@example([(WEST, 3), (EAST, 774), (WEST, 2), (EAST, 20)])
def test_the_setpoint_stays_inside_for_any_sequence_of_goals(moves):
    setpoint = Path(DynamicsParams(), (0.0, 0.0, 1.0))
    worst = -1.0
    for goal, periods in moves:
        setpoint.goto(*goal)
        for _ in range(periods):
            setpoint.advance()
            worst = max(worst, excursion(setpoint.setpoint[:3]))
    assert worst <= 1e-6


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(4))
def test_the_setpoint_stays_inside_on_random_missions(seed):
    rng = random.Random(seed)
    worst = -1.0
    for _ in range(60):
        setpoint = Path(DynamicsParams(), (0.0, 0.0, 1.0))
        for _ in range(8):
            setpoint.goto(wall(rng, 5.0), wall(rng, 5.0), rng.choice((0.0, 2.0, rng.uniform(0, 2))))
            for _ in range(rng.choice((1, rng.randint(1, 300)))):
                setpoint.advance()
                worst = max(worst, excursion(setpoint.setpoint[:3]))
    assert worst <= 1e-6


def wall(rng, size):
    """Return a random coordinate, often on a wall or in the middle."""
    return rng.choice((-size, 0.0, size)) if rng.random() < 0.6 else rng.uniform(-size, size)


@pytest.mark.parametrize("seed", range(3))
def test_the_vehicle_stays_inside_within_a_centimetre(seed):
    rng = random.Random(seed)
    vehicle = Vehicle(DynamicsParams())
    vehicle.goto(0.0, 0.0, 1.0)
    vehicle.advance(1500)
    worst = -1.0
    for _ in range(6):
        vehicle.goto(wall(rng, 5.0), wall(rng, 5.0), rng.choice((2.0, rng.uniform(0.2, 2.0))))
        for _ in range(rng.randint(20, 250)):
            vehicle.advance(10)
            worst = max(worst, excursion(vehicle.position))
    assert worst <= 0.01


SPEED, ACCELERATION, JERK = 5.0, 5.0, 40.0
MICROMETRE = 1e-6
ROUNDING = 1e-9
LAG = 1e-4
"""Tolerance: the lags take the jerk as constant over a period, an error of 1 in 1e4."""
LIMITS = st.tuples(st.floats(0.5, 10), st.floats(0.5, 20), st.floats(5, 200))
GOALS = st.one_of(st.floats(-20, 20), st.floats(-1, 1), st.floats(-0.05, 0.05))
UNIT = st.floats(-1, 1)
POINT = st.tuples(st.floats(-10, 10), st.floats(-10, 10), st.floats(1, 20))


def side(v: float, a: float, gap: float, most_a: float, j: float) -> float:
    return 1.0 if stop(v, a, most_a, j) <= gap else -1.0


def path(start: Motion, goal: float, limits: tuple[float, float, float]) -> Iterator[Motion]:
    """Yield every state of an axis after the start until it is at rest on the goal."""
    (p, v, a), heading = start, side(start[1], start[2], goal - start[0], limits[1], limits[2])
    most_v, most_a, j = limits
    for _ in range(100_000):
        p, v, a, heading = advance_axis(p, v, a, goal, heading, most_v, most_a, most_a, j)
        yield p, v, a
        if (p, v, a) == (goal, 0.0, 0.0):
            return
    pytest.fail("never came to rest on the goal")


def scurve(way: float, most_v: float, most_a: float, j: float) -> float:
    """Return the duration of the time-optimal move from rest to rest (seven segments)."""
    if most_v * j < most_a**2:
        most_a = sqrt(most_v * j)
    if way < 2 * most_a**3 / j**2:
        return 4 * (way / (2 * j)) ** (1 / 3)
    peak = min(most_v, most_a / 2 * (sqrt((most_a / j) ** 2 + 4 * way / most_a) - most_a / j))
    return way / peak + peak / most_a + most_a / j


def started(limits: tuple[float, float, float], speed: float, part: float) -> Motion:
    """Return a motion within the limits that can stay within them."""
    most_v, most_a, j = limits
    v, a = speed * most_v, part * most_a
    for sign in (1.0, -1.0):
        assume(sign * (v + a * abs(a) / (2 * j) + 0.5 * a * PERIOD) <= most_v)
    return 0.0, v, a


def stopping(start: Motion, end: float, limits: tuple[float, float, float]) -> Iterator[Motion]:
    """Yield the start and every state of the time-minimal stop."""
    p, v, a = start
    yield p, v, a
    while (v, a) != (0.0, 0.0):
        p, v, a = decelerate(p, v, a, end, limits[1], limits[2], PERIOD)
        yield p, v, a


@given(LIMITS, UNIT, UNIT)
def test_a_stop_ends_at_the_predicted_place_and_is_smooth(limits, speed, part):
    start = started(limits, speed, part)
    end = stop(start[1], start[2], limits[1], limits[2])
    states = list(stopping(start, end, limits))
    for before, now in pairwise(states):
        drift = PERIOD * before[1] + 0.5 * PERIOD**2 * before[2]
        assert abs(now[0] - before[0] - drift) <= limits[2] * PERIOD**3 / 6 + ROUNDING
    assert states[-1][0] == end


@given(LIMITS, UNIT, UNIT, GOALS)
def test_an_axis_arrives_smoothly_within_its_limits(limits, speed, part, goal):
    before = started(limits, speed, part)
    for now in path(before, goal, limits):
        assert abs(now[1]) <= limits[0] + ROUNDING
        assert abs(now[2]) <= limits[1] + ROUNDING
        assert abs(now[2] - before[2]) <= limits[2] * PERIOD + ROUNDING
        assert (
            abs(now[1] - before[1] - PERIOD * before[2]) <= 0.5 * limits[2] * PERIOD**2 + ROUNDING
        )
        drift = PERIOD * before[1] + 0.5 * PERIOD**2 * before[2]
        assert abs(now[0] - before[0] - drift) <= limits[2] * PERIOD**3 / 6 + ROUNDING
        before = now


@pytest.mark.thorough
@given(LIMITS, UNIT, UNIT, GOALS)
@example((3.0, 14.0, 8.0), -0.09375, 0.171875, -0.015625)
def test_an_axis_does_not_overshoot_a_reachable_goal(limits, speed, part, goal):
    start = started(limits, speed, part)
    end = stop(start[1], start[2], limits[1], limits[2])
    ahead = 1.0 if end > 0.0 else -1.0
    assume(ahead * goal >= ahead * end)
    # A stop that turns round on its way has passed its end, and may have passed the goal.
    most = max(ahead * goal, *(ahead * p for p, _, _ in stopping(start, end, limits)))
    assert max(ahead * p for p, _, _ in path(start, goal, limits)) <= most + MICROMETRE


@given(LIMITS, st.floats(1e-4, 20))
def test_a_move_from_rest_to_rest_is_time_optimal(limits, way):
    periods = sum(1 for _ in path((0.0, 0.0, 0.0), way, limits))
    assert abs(periods - ceil(scurve(way, *limits) / PERIOD)) <= 3


@pytest.mark.parametrize(
    ("v", "a", "goal", "seconds"),
    [
        (-4.0614, 1.1549, -9.43305, 2.484785942),
        (1.61855, -1.48128, 0.6465, 0.617379385),
        (4.74785, 0.32563, 5.38109, 1.642341583),
        (-0.22, 4.4, 0.01, 0.251099539),
        (3.0, -4.0, 0.95, 0.678621180),
    ],
)
def test_a_move_from_motion_is_as_fast_as_ruckigs(v, a, goal, seconds):
    """The durations are those of ruckig 0.15, an independent solver of the same problem."""
    periods = sum(1 for _ in path((0.0, v, a), goal, (SPEED, ACCELERATION, JERK)))
    assert -1e-6 <= periods - seconds / PERIOD <= 2


def fly(trajectory: Path, most_seconds: float = 60.0) -> Iterator[tuple[float, ...]]:
    """Yield every setpoint until the trajectory is at rest."""
    for _ in range(round(most_seconds / PERIOD)):
        trajectory.advance()
        yield trajectory.setpoint
        if trajectory.at_rest:
            return
    pytest.fail("never at rest")


def off_line(point: tuple[float, ...], start: tuple[float, ...], goal: tuple[float, ...]) -> float:
    way = [g - s for g, s in zip(goal, start, strict=True)]
    from_start = [x - s for x, s in zip(point, start, strict=True)]
    t = sum(a * b for a, b in zip(way, from_start, strict=True)) / sum(w * w for w in way)
    return dist(from_start, [t * w for w in way])


@pytest.mark.thorough
@settings(max_examples=30)
@given(POINT, POINT)
def test_from_rest_the_path_is_straight_and_within_limits(start, goal):
    assume(dist(start, goal) > 0.01)
    trajectory = Path(DynamicsParams(), start)
    trajectory.goto(*goal)
    for s in fly(trajectory):
        assert off_line(s[:3], start, goal) < 1e-3
        assert hypot(*s[3:6]) <= SPEED * (1 + LAG)
        assert hypot(*s[6:9]) <= ACCELERATION * (1 + LAG)
        assert hypot(*s[9:12]) <= JERK * (1 + LAG)
        assert dist(s[:3], start) <= dist(goal, start) + MICROMETRE
    assert trajectory.setpoint == (*goal, *(0.0,) * 15)


def test_an_axis_at_the_end_of_a_slow_stop_leaves_the_limits_to_the_others():
    start, goal = (1.078, -3.417, 0.1412), (3.944, 4.0, 2.55)
    x, y = map(generator.standing_at, start[:2])
    sinking = (0.14131, -0.00316, 0.0737, start[2], 0.0, 0.0215, 0.0, 0.0, 0.0)
    limits = generator.limits_of(DynamicsParams())
    *axes, _, _, _, _ = generator.goto((x, y, sinking, 1.0, 1.0, 0.0, 0.0), *goal, limits)
    along = [(g - s) / dist(start, goal) for s, g in zip(start, goal, strict=True)]
    assert [axis[5] for axis in axes] == pytest.approx(along, rel=0.01)


@settings(max_examples=20)
@given(st.lists(st.tuples(POINT, st.floats(0.02, 1)), min_size=2, max_size=6))
@example([((1.0, 0.0, 10.0), 0.5), ((5.0, 0.0, 11.0), 0.5), ((0.0, 0.0, 15.0), 1.0)])
def test_a_goal_moved_in_flight_is_followed_smoothly(legs):
    trajectory = Path(DynamicsParams(), (0.0, 0.0, 10.0))
    before = trajectory.setpoint
    for goal, seconds in legs:
        trajectory.goto(*goal)
        for _ in range(ceil(seconds / PERIOD)):
            trajectory.advance()
            s = trajectory.setpoint
            for k in range(3):
                # Position and velocity are the integrals of velocity and acceleration.
                mean = 0.5 * (s[k + 3] + before[k + 3])
                assert abs(s[k] - before[k] - PERIOD * mean) < 30 * MICROMETRE
                mean = 0.5 * (s[k + 6] + before[k + 6])
                assert abs(s[k + 3] - before[k + 3] - PERIOD * mean) < 0.5 * JERK * PERIOD**2
            assert hypot(*s[6:9]) <= ACCELERATION * (1 + LAG)
            assert hypot(*s[9:12]) <= JERK * (1 + LAG)
            # An axis that loses a part of its share slows down, but not at once.
            assert hypot(*s[3:6]) <= SPEED * 1.4
            before = s
    for s in fly(trajectory):
        before = s
    assert before == (*legs[-1][0], *(0.0,) * 15)


@settings(max_examples=30)
@given(st.lists(st.tuples(POINT, st.floats(0.1, 2)), min_size=2, max_size=6))
def test_moved_goals_are_not_overshot_beyond_the_farthest(legs):
    """Only the latest goal may be overshot, if another axis needs the limits; an older one never."""
    trajectory = Path(DynamicsParams(), (0.0, 0.0, 10.0))
    corners = [(0.0, 0.0, 10.0)]
    for goal, seconds in legs:
        trajectory.goto(*goal)
        corners.append(goal)
        trajectory.advance_for(seconds)
    axes = [(min(axis), max(axis)) for axis in zip(*corners, strict=True)]
    for s in fly(trajectory):
        for value, (low, high) in zip(s[:3], axes, strict=True):
            assert low - 10 * MICROMETRE <= value <= high + 10 * MICROMETRE


@pytest.mark.thorough
@settings(max_examples=30)
@given(POINT, POINT, st.floats(0.1, 2))
@example((1.0, 0.5, 1.0), (0.0, 10.0, 1.0), 1.5)
def test_a_goal_moved_in_flight_is_reached_within_20_s(first, then, seconds):
    trajectory = Path(DynamicsParams(), (0.0, 0.0, 10.0))
    trajectory.goto(*first)
    trajectory.advance_for(seconds)
    trajectory.goto(*then)
    # Earlier an axis crawled for 70 s with almost no share, while another needed all of it.
    for _ in fly(trajectory, 20.0):
        pass
    assert trajectory.setpoint[:3] == then


@settings(max_examples=30)
@given(POINT, POINT, POINT, st.floats(0.1, 1.5), st.floats(0.1, 1.5))
@example((-4.0, -8.9, 10.0), (-8.0, -4.0, 12.0), (1.7, 4.0, 12.0), 1.5, 0.6)
def test_an_axis_that_has_to_turn_round_does_so_within_2_s(first, then, last, seconds, later):
    trajectory = Path(DynamicsParams(), (0.0, 0.0, 10.0))
    for goal, time in ((first, seconds), (then, later)):
        trajectory.goto(*goal)
        trajectory.advance_for(time)
    trajectory.goto(*last)
    # Earlier an axis waited for the others to stop accelerating: up to 3 s, on its way out.
    trajectory.advance_for(2.0)
    for p, v, goal in zip(trajectory.setpoint[:3], trajectory.setpoint[3:6], last, strict=True):
        assert v * (goal - p) >= -ROUNDING


@settings(max_examples=30)
@given(POINT, POINT, st.floats(0.1, 2), st.floats(0.1, 1))
@example((1.0, 0.5, 1.0), (0.0, 10.0, 1.0), 1.5, 0.4)
def test_a_flight_to_a_moved_goal_stops_within_10_s(first, then, seconds, later):
    trajectory = Path(DynamicsParams(), (0.0, 0.0, 10.0))
    for goal, time in ((first, seconds), (then, later)):
        trajectory.goto(*goal)
        trajectory.advance_for(time)
    trajectory.brake()
    # Earlier it took up to a minute when an axis had almost no share to brake with.
    for _ in fly(trajectory, 10.0):
        pass


@pytest.mark.thorough
@settings(max_examples=20)
@given(POINT, st.floats(0.1, 3))
@example((6.103515625e-05, 5e-80, 1.0), 0.5)  # x is soon there, and z stops 16 nm nearer
def test_braking_ends_ahead_without_turning_back(goal, seconds):
    start = (0.0, 0.0, 10.0)
    trajectory = Path(DynamicsParams(), start)
    trajectory.goto(*goal)
    trajectory.advance_for(seconds)
    trajectory.brake()
    stops = trajectory.goal
    way = [g - s for g, s in zip(goal, start, strict=True)]
    for s in fly(trajectory, 6.0):
        assert sum(v * w for v, w in zip(s[3:6], way, strict=True)) >= -ROUNDING
    # An axis that gains the share of another one stops nearer than was planned, never farther.
    ends = trajectory.setpoint[:3]
    assert dist(ends, trajectory.goal) < ROUNDING
    assert sum((s - e) * w for s, e, w in zip(stops, ends, way, strict=True)) >= -ROUNDING


@settings(max_examples=30)
@given(POINT, POINT, st.floats(0.1, 2), st.floats(0.05, 1))
@example((-10.0, 0.0, 10.0), (1.0, 9.0, 1.0), 1.2, 0.85)
def test_braking_does_not_speed_up_an_axis(first, then, seconds, later):
    trajectory = Path(DynamicsParams(), (0.0, 0.0, 10.0))
    for goal, time in ((first, seconds), (then, later)):
        trajectory.goto(*goal)
        trajectory.advance_for(time)
    trajectory.brake()
    # By then the initial acceleration has been removed and the lags have settled.
    trajectory.advance_for(0.6)
    before = [abs(v) for v in trajectory.setpoint[3:6]]
    for s in fly(trajectory, 10.0):
        now = [abs(v) for v in s[3:6]]
        assert all(v <= w + 0.01 for v, w in zip(now, before, strict=True))
        before = now
