"""Verdicts of rows on flights that are made up."""

from collections.abc import Callable, Sequence
from typing import Any

import pytest
from msgspec.structs import replace

from quadctl.cli.lab.flown import FlownMission, Outcome
from quadctl.cli.lab.rubric import (
    RowVerdict,
    RubricRow,
    WaypointStep,
)
from quadctl.cli.lab.verdict import judge
from quadctl.cli.mission.mission import CageStep, Calibrate, CallStep, GotoStep, Row
from quadctl.schemas.messages import (
    BodyRates,
    CageSize,
    Pose,
    Position,
    Pressure,
    Quaternion,
    SafetyState,
    Setpoint,
    StateName,
    Velocity,
)
from quadctl.schemas.params import Params
from quadctl.schemas.services import CalibrateResponse, GotoResponse, ToggleCageResponse
from quadctl.services.runtime.errors import Refused


def replied(step: Row) -> Outcome:
    """Return a step with the reply of a node that accepts everything."""
    replies: dict[type[Row], Any] = {
        GotoStep: GotoResponse(True, ""),
        CageStep: ToggleCageResponse(True),
        Calibrate: CalibrateResponse(0.0),
    }
    return Outcome(step, replies[type(step)], None)


def judged(
    expect: Any,
    steps: Sequence[Row],
    x: Callable[[float], float],
    *,
    hovers: Callable[[float], bool] = lambda _at: True,
    verifies: float = -1.0,
    refuses: bool = False,
    setpoint: float = 0.0,
    shown: Callable[[float], float] = lambda _at: 0.0,
    **keys: Any,
) -> RowVerdict:
    """Return the verdict on 9 s of flight at 1 m along `x` (m), each a function of the time (s)."""
    turn, rates = Quaternion(1, 0, 0, 0), BodyRates(0, 0, 0)
    poses, states = list[Pose](), list[SafetyState]()
    for seq in range(901):
        at = seq / 100
        velocity = Velocity((x(at) - x(at - 0.01)) / 0.01, 0, 0)
        poses.append(Pose("b", seq, at, Position(x(at), 0, 1), velocity, turn, rates))
        if seq % 5 == 0:
            state: StateName = "HOVERING" if hovers(at) else "MOVING"
            goal, cage = Position(0, 0, 1), CageSize(5, 5, 5)
            states.append(SafetyState("b", at, 1, state, goal, True, cage, ""))
            if at == verifies:
                states.append(replace(states[-1], state="VERIFYING"))
    setpoints = [Setpoint("b", seq, Position(setpoint, 0, 1), False) for seq in range(0, 901, 5)]
    readings = [Pressure(n / 10, shown(n / 10), 0, 0, 0) for n in range(91)]
    outcomes = [replied(step) for step in steps]
    if refuses:
        outcomes[-1] = Outcome(steps[-1], GotoResponse(False, "no"), None)
    flown = FlownMission(Params(), outcomes, poses, states, readings, setpoints)
    return judge(RubricRow("r", expect, **keys), flown)


@pytest.mark.parametrize(
    ("range_", "output"),
    [(0.5, "goto 4 0 1: arrived, 0.00 m away"), (0.9, "HOVERING 0.90 m from it")],
)
def test_an_arrival_is_not_reported_before_the_acceptance_range(range_: float, output: str):
    def x(at: float) -> float:
        return min(max(at - 1.0, 0.0), 4.0)

    arrival = 5.0 - range_
    verdict = judged(
        "arrives", [GotoStep(1.0, 4.0, 0.0, 1.0)], x, hovers=lambda at: not 1 < at < arrival
    )
    assert output in verdict.output
    assert verdict.ok is (range_ == 0.5)


AWAY = GotoStep(3.0, 4.0, 0.0, 1.0)


def flight(at: float) -> float:
    """Return the place (m) of a vehicle that flies 4 m from 3 s on, at 2 m/s."""
    return min(max(2 * (at - 3), 0), 4)


def at_rest(_at: float) -> float:
    return 0.0


def until(end: float) -> Callable[[float], bool]:
    """Return which states of a flight are HOVERING: those up to 3 s, and from an end (s) on."""
    return lambda at: at <= 3 or at >= end


@pytest.mark.parametrize(
    ("expect", "x", "more", "output"),
    [
        ("refused", at_rest, {"verifies": 3.0}, ""),
        ("refused", at_rest, {}, "refused, no, but safety/state showed no VERIFYING for it"),
        ("refused", at_rest, {"hovers": lambda at: at > 3.5}, "MOVING when it came, not HOVERING"),
        (
            "refused", at_rest, {"verifies": 3.0, "hovers": lambda at: at < 5},
            "but safety/state showed MOVING at 5.00 s",
        ),
        (
            "refused", at_rest, {"verifies": 3.0, "setpoint": 4.0},
            "but input/position had it, for pose 0",
        ),
        ("refused", flight, {"verifies": 3.0}, "was refused, but the vehicle moved 4.00 m"),
        ("parameter_obeyed", at_rest, {"verifies": 3.0}, "was refused, no, with a cage of 5 5 5"),
        ("arrives", flight, {"hovers": until(4.8)}, ""),
        ("arrives", flight, {"hovers": until(4.3)}, "HOVERING 1.40 m from it"),
        ("arrives", flight, {"hovers": until(6.0)}, "HOVERING 1.2 s after it was 0.5 m away"),
        ("arrives", flight, {}, "safety/state showed no MOVING"),
        ("arrives", flight, {"hovers": lambda at: at <= 3 or 4.8 <= at < 6}, "MOVING at 6.00 s, after"),
        ("arrives", at_rest, {"hovers": until(99)}, "4.00 m away from it at the end"),
        ("transitions", flight, {"hovers": until(4.8), "verifies": 3.0}, ""),
        ("transitions", flight, {"hovers": until(4.8)}, "showed HOVERING, MOVING, HOVERING"),
        ("transitions", flight, {"verifies": 3.0}, "showed HOVERING, VERIFYING, HOVERING"),
    ],
)  # fmt: skip
def test_what_a_node_shows_on_a_goal_is_judged(
    expect: str, x: Callable[[float], float], more: dict[str, Any], output: str
):
    refuses = expect in {"refused", "parameter_obeyed"}
    verdict = judged(expect, [AWAY], x, refuses=refuses, **more)
    assert output in verdict.output
    assert verdict.ok is (not output)


@pytest.mark.parametrize(
    ("refuses", "x", "output"),
    [
        (True, lambda at: min(max(2 * (at - 1), 0), 4), ""),
        (True, lambda at: min(max(2 * (at - 1), 0), 3), "goto 4 0 1: 1.00 m away from it"),
        (False, lambda at: min(max(2 * (at - 1), 0), 4), "goto 0 0 1: 4.00 m away from it"),
        (False, at_rest, ""),
    ],
)
def test_a_goal_in_flight_is_refused_or_reached(
    refuses: bool, x: Callable[[float], float], output: str
):
    steps = [replace(AWAY, at=1.0), GotoStep(2.0, 0.0, 0.0, 1.0)]
    verdict = judged("answers_in_flight", steps, x, refuses=refuses)
    assert output in verdict.output
    assert verdict.ok is (not output)


OUT = [CageStep(0.5, False), GotoStep(1.0, 9.0, 0.0, 1.0), CageStep(3.0, True)]
BACK = GotoStep(6.0, 1.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("steps", "x", "output"),
    [
        (OUT, lambda at: min(max(at - 1, 0), 2.5), ""),
        (OUT, lambda at: max(at - 1, 0), "3 m beyond the cage at 9.0 s"),
        (OUT, lambda at: min(max(at - 1, 0), 1.5), "was not on its way to goto 9 0 1"),
        (OUT, lambda at: min(max(at - 1, 0), 3) - max(at - 7, 0), "still moves 6.0 s later"),
        ([*OUT, BACK], lambda at: min(max(at - 1, 0), 2.5, max(8.5 - at, 1)), ""),
        ([*OUT, BACK], lambda at: min(max(at - 1, 0), 2.5), "goto 1 0 1: HOVERING 1.50 m from it"),
    ],
)
def test_a_vehicle_on_its_way_out_stops_and_flies_to_a_later_goal(
    steps: list[Row], x: Callable[[float], float], output: str
):
    verdict = judged("stops", steps, x, hovers=lambda at: not 6 < at < 7)
    assert output in verdict.output
    assert verdict.ok is (not output)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_zeroed_barometer_follows_the_height(sign: int):
    """Climbing by 1 m lowers the pressure by 0.12 hPa."""
    climbed = [Pose("b", n, n / 10, Position(0, 0, min(max(n / 10 - 4, 1), 2)), Velocity(0, 0, 0),
                    Quaternion(1, 0, 0, 0), BodyRates(0, 0, 0)) for n in range(91)]  # fmt: skip
    zeroed = [sign * 0.12 * (1 - p.position.z) + AIR * (p.stamp < 3) for p in climbed]
    readings = [Pressure(p.stamp, x, 0, 0, 0) for p, x in zip(climbed, zeroed, strict=True)]
    flown = FlownMission(Params(), [replied(Calibrate(3.0))], climbed, [], readings)
    assert judge(RubricRow("r", "zeroed"), flown).ok is (sign > 0)


EACH = [GotoStep(1.0, 4.0, 0.0, 1.0), GotoStep(5.0, 0.0, 0.0, 1.0)]


@pytest.mark.parametrize(
    ("each", "back", "output"),
    [(False, 5.0, ""), (True, 5.0, ""), (False, 3.5, ""), (True, 3.5, "goto 4 0 1: HOVERING")],
)
def test_with_each_every_goal_is_reached_before_the_next(each: bool, back: float, output: str):
    """The vehicle is on its way back from a time (s) on, the node as if it were there until 5 s."""

    def x(at: float) -> float:
        out = min(max(2 * (at - 1), 0), 4)
        return max(out - max(2 * (at - back), 0), 0) if at > back else out

    more: Any = {"hovers": lambda at: at <= 1 or 2.8 < at <= 5 or at > 6.8}
    if back < 5:
        more = {"hovers": lambda at: at <= 1 or 4.0 < at <= 5 or at > 5.2}
    verdict = judged("arrives", EACH, x, each=each, **more)
    assert output in verdict.output
    assert verdict.ok is (not output)


FLOWN = FlownMission(Params(), [], [], [], [])


@pytest.mark.parametrize(
    ("logged", "holds"),
    [
        ("Param: cage x - [-5.0, 5.00]", True),
        ("[INFO] Param:  cage x - [-5, 5]", True),
        ("Param: cage x - [-5, 2.0]", False),
        ("Param: cage y - [-5, 5]", False),
    ],
)
def test_a_printed_line_counts_in_whatever_form_its_numbers_are(logged: str, holds: bool):
    row = RubricRow("r", "prints", lines=["Param: cage x - [-5, 5]"])
    assert judge(row, FLOWN._replace(log=["starting", logged])).ok is holds


@pytest.mark.parametrize(
    ("reply", "output"),
    [
        ({"baseline": 1013.2, "more": 1}, ""),
        ({"baseline": 1015}, "the reply's baseline is 1015, not 1013.1"),
        ({"baseline": True}, "the reply's baseline is True, not 1013.1"),
        ({}, "the reply's baseline is None, not 1013.1"),
        ([1013.1], "the reply is [1013.1], and has no fields"),
    ],
)
def test_the_fields_of_an_own_services_reply_are_compared(reply: Any, output: str):
    outcomes = [Outcome(CallStep(4.0, "own/calibrate"), reply, None)]
    row = RubricRow("r", "replies", reply={"baseline": 1013.1}, within=1.0)
    verdict = judge(row, FLOWN._replace(outcomes=outcomes))
    assert output in verdict.output
    assert verdict.ok is (not output)


@pytest.mark.parametrize(
    ("goal", "x", "more", "output"),
    [
        (4.0, flight, {"hovers": until(4.8), "verifies": 3.0}, ""),
        (4.0, flight, {"verifies": 3.0}, "showed HOVERING, VERIFYING, HOVERING"),
        (4.0, at_rest, {"hovers": until(4.8), "verifies": 3.0}, "4.00 m away from it at 9 s"),
        (9.0, at_rest, {"verifies": 3.0}, ""),
        (9.0, at_rest, {}, "showed HOVERING"),
        (9.0, flight, {"verifies": 3.0}, "is not permitted, but the vehicle moved 4.00 m"),
    ],
)
def test_a_waypoint_is_verified_as_a_requested_goal(
    goal: float, x: Callable[[float], float], more: dict[str, Any], output: str
):
    steps = [WaypointStep(3.0, goal, 0.0, 1.0)]
    verdict = judged("takes_waypoints", [], x, waypoints=steps, **more)
    assert output in verdict.output
    assert verdict.ok is (not output)


@pytest.mark.parametrize(
    ("goal", "refuses", "output"),
    [
        (9.0, True, ""),
        (9.0, False, "goto 9 0 1: was accepted, so no refusal has a reason"),
        (4.0, False, ""),
    ],
)
def test_a_node_that_refuses_no_goal_outside_gives_no_reason(
    goal: float, refuses: bool, output: str
):
    steps = [GotoStep(3.0, goal, 0.0, 1.0)]
    verdict = judged("answers", steps, at_rest, refuses=refuses, service="goto")
    assert output in verdict.output
    assert verdict.ok is (not output)


@pytest.mark.parametrize(("first", "ok"), [(0.0, True), (0.5, True), (3.0, False)])
def test_before_the_first_reading_a_calibration_may_be_refused(first: float, ok: bool):
    steps = [Calibrate(first), Calibrate(4.0)]
    outcomes = [
        Outcome(steps[0], None, Refused("no reading yet", "")),
        Outcome(steps[1], CalibrateResponse(AIR), None),
    ]
    pose = Pose("b", 0, 0, Position(0, 0, 1), Velocity(0, 0, 0), Quaternion(1, 0, 0, 0), BodyRates(0, 0, 0))  # fmt: skip
    readings = [Pressure(n / 10, AIR, 0, 0, 0) for n in range(5, 60)]
    flown = FlownMission(Params(), outcomes, [pose], [], readings)
    assert judge(RubricRow("r", "answers"), flown).ok is ok


AIR = 1013.13
"""Pressure at 1 m, hPa."""


@pytest.mark.parametrize(
    ("shown", "output"),
    [
        (lambda at: 0.0 if 3 < at < 6 else AIR, ""),
        (lambda at: AIR, "after `calibrate`, not 0"),
        (lambda at: 0.0 if at > 3 else AIR, "after `calibrate --unset`, not 1013.13"),
    ],
)
def test_each_calibration_is_obeyed_until_the_next(shown: Callable[[float], float], output: str):
    steps = [Calibrate(3.0), Calibrate(6.0, unset=True)]
    verdict = judged("zeroed", steps, lambda _at: 0.0, shown=shown)
    assert output in verdict.output
    assert verdict.ok is (not output)


@pytest.mark.parametrize(
    ("baselines", "output"),
    [
        ((1013.0, 1012.88), ""),  # another model of the air, by an offset
        ((1013.0, 1013.0), "+0.000 hPa since the first baseline, not -0.120"),
        ((1013.0, 1013.12), "+0.120 hPa since the first baseline, not -0.120"),
        ((1013.0, 0.0), "baseline 0 hPa, not 1013.01 hPa"),
    ],
)
def test_a_second_baseline_follows_the_height(baselines: tuple[float, float], output: str):
    poses = [Pose("b", n, n / 10, Position(0, 0, 1 if n < 50 else 2), Velocity(0, 0, 0),
                  Quaternion(1, 0, 0, 0), BodyRates(0, 0, 0)) for n in range(91)]  # fmt: skip
    readings = [Pressure(pose.stamp, baselines[0], 0, 0, 0) for pose in poses]
    outcomes = [
        Outcome(Calibrate(at), CalibrateResponse(baseline), None)
        for at, baseline in zip((3.0, 8.0), baselines, strict=True)
    ]
    flown = FlownMission(Params(), outcomes, poses, [], readings)
    verdict = judge(RubricRow("r", "answers"), flown)
    assert output in verdict.output
    assert verdict.ok is (not output)


@pytest.mark.parametrize("baseline", [0.0, 1013.2])
def test_an_undone_calibration_replies_that_there_is_no_baseline(baseline: float):
    poses = [Pose("b", n, n / 10, Position(0, 0, 1), Velocity(0, 0, 0), Quaternion(1, 0, 0, 0),
                  BodyRates(0, 0, 0)) for n in range(91)]  # fmt: skip
    readings = [Pressure(pose.stamp, AIR, 0, 0, 0) for pose in poses]
    undone = Outcome(Calibrate(3.0, unset=True), CalibrateResponse(baseline), None)
    verdict = judge(RubricRow("r", "zeroed"), FlownMission(Params(), [undone], poses, [], readings))
    assert verdict.ok is (not baseline)


@pytest.mark.parametrize("follows", [True, False])
def test_readings_without_a_baseline_follow_the_height(follows: bool):
    climbed = [Pose("b", n, n / 10, Position(0, 0, min(max(n / 10 - 4, 1), 2)), Velocity(0, 0, 0),
                    Quaternion(1, 0, 0, 0), BodyRates(0, 0, 0)) for n in range(91)]  # fmt: skip
    readings = [Pressure(p.stamp, 1013.3 - 0.12 * p.position.z * follows, 0, 0, 0) for p in climbed]
    flown = FlownMission(Params(), [replied(Calibrate(3.0, unset=True))], climbed, [], readings)
    assert judge(RubricRow("r", "zeroed"), flown).ok is follows
