"""Verdicts on flights of a student's nodes, from what the bus showed. Pure.

The true poses count, and the parameters of the launch; what a node reports of itself counts only
where its report is the question.
"""

from itertools import pairwise
from math import dist, inf
from statistics import fmean

from msgspec.structs import astuple

from quadctl.cli.lab.extra import STILL, prints, replies, takes_waypoints
from quadctl.cli.lab.flown import (
    Commanded,
    FlownMission,
    Outcome,
    distance,
    excursion,
    first_at,
    goal_of,
    gotos,
    permits,
    pose_at,
    speed,
    time_to_arrive,
    until,
)
from quadctl.cli.lab.rubric import RowVerdict, RubricRow
from quadctl.cli.mission.mission import CageStep, Calibrate, GotoStep
from quadctl.schemas.messages import SafetyState
from quadctl.schemas.services import (
    GotoResponse,
    ToggleCageResponse,
)
from quadctl.schemas.topics import CALIBRATE, GOTO, PRESSURE, SETPOINT
from quadctl.services.airspace.geometry import place_of
from quadctl.services.airspace.stopping import AT_REST
from quadctl.services.pressure.simulated import pressure_at
from quadctl.services.runtime.errors import Refused

_SOON = 0.3
"""Simulated seconds within which a node must show a change of its state, or take it back."""
_BEFORE = 1.2 / SETPOINT.hz
"""Seconds by which a state's stamp may be earlier than what it shows: that of the pose before."""
_BUSY = 1.5
"""Seconds after an arrival, or at rest after a stop, in which a node may still be busy."""
_SAME = 1e-3
"""Metres between two equal places."""
_AIR = 1.0
"""hPa by which a barometer, and so a baseline, may differ from the standard atmosphere."""
_ZERO = 0.01
"""hPa by which a zeroed reading may differ from the change of the air's pressure since."""
_MOST = 1.5
"""Times the barometer's rate that it may have."""
_MODEL = 0.1
"""Share by which the change of a barometer's model with the height may differ from ours."""


def judge(row: RubricRow, flown: FlownMission) -> RowVerdict:
    """Return the verdict on one flight."""
    for outcome in flown.outcomes:
        if outcome.problem is not None and not isinstance(outcome.problem, Refused):
            return RowVerdict(False, f"{outcome.step}: {outcome.problem.message}")
    return _JUDGES[row.expect](row, flown)


def _refused(row: RubricRow, flown: FlownMission) -> RowVerdict:
    *earlier, outcome = gotos(flown)
    for each in earlier:
        if not each.accepted:
            return RowVerdict(False, f"{each.step}: {_refusal(each)}")
        # A refusal on the way to another goal shows nothing of the verification.
        away = distance(pose_at(flown.poses, outcome.step.at), goal_of(each.step))
        if each is earlier[-1] and away > flown.params.safety.acceptance_range:
            return RowVerdict(
                False, f"{each.step}: still {away:.2f} m away when the next goal came"
            )
    fault = "was accepted" if outcome.accepted else _wrong_refusal(flown, outcome)
    if fault:
        return RowVerdict(False, f"{outcome.step}: {fault}")
    moved = distance(pose_at(flown.poses, outcome.step.at), place_of(flown.poses[-1]))
    if moved > (row.within or STILL):
        return RowVerdict(
            False, f"{outcome.step}: was refused, but the vehicle moved {moved:.2f} m"
        )
    return RowVerdict(True, f"{outcome.step}: {_refusal(outcome)}")


def _shown(flown: FlownMission, at: float) -> tuple[str, list[SafetyState]]:
    """Return the state when a request came, at a time (s), and the states shown since.

    The first of these is VERIFYING if the request was verified from HOVERING.
    """
    states = flown.states
    first = first_at(states, at - _BEFORE)
    while first < first_at(states, at + _SOON) and states[first].state == "HOVERING":
        first += 1
    return states[first - 1].state if first else "nothing", [*states[first:]]


def _unverified(flown: FlownMission, outcome: Outcome) -> str:
    """Return what the verification of a goal lacks; empty if it lacks nothing."""
    before, since = _shown(flown, outcome.step.at)
    if before != "HOVERING":
        return f"safety/state showed {before} when it came, not HOVERING"
    if not since or since[0].state != "VERIFYING":
        return "safety/state showed no VERIFYING for it"
    return ""


def _wrong_refusal(flown: FlownMission, outcome: Outcome) -> str:
    """Return what is wrong with a refusal by the verification; empty if nothing is."""
    if fault := _unverified(flown, outcome):
        return f"{_refusal(outcome)}, but {fault}"
    if fault := _flown_all_the_same(flown, outcome):
        return fault
    at = outcome.step.at
    next_goal = min((each.step.at for each in gotos(flown) if each.step.at > at), default=inf)
    for state in flown.states[first_at(flown.states, at + _SOON) :]:
        if state.stamp < next_goal - _BEFORE and state.state != "HOVERING":
            return f"was refused, but safety/state showed {state.state} at {state.stamp:.2f} s"
    return ""


def _flown_all_the_same(flown: FlownMission, outcome: Outcome) -> str:
    """Return that a refused goal was published as a setpoint; empty if it was not."""
    goal = goal_of(outcome.step)
    if any(each.accepted and dist(goal_of(each.step), goal) < _SAME for each in gotos(flown)):
        return ""
    for setpoint in flown.setpoints:
        if dist(astuple(setpoint.position), goal) < _SAME:
            return f"was refused, but input/position had it, for pose {setpoint.for_seq}"
    return ""


def _arrives(row: RubricRow, flown: FlownMission) -> RowVerdict:
    if fault := _refused_from_the_first(flown):
        return RowVerdict(False, fault)
    goals = gotos(flown)
    for outcome, later in pairwise(goals) if row.each else ():
        verdict = _flight_to(row, until(flown, later.step.at - _BEFORE), outcome)
        if not verdict.ok:
            return verdict
    return _flight_to(row, flown, goals[-1])


def _flight_to(row: RubricRow, flown: FlownMission, outcome: Outcome) -> RowVerdict:
    """Return the verdict on a goal that has to be accepted, and on the flight to it until the end."""
    if not outcome.accepted:
        return RowVerdict(False, f"{outcome.step}: {_refusal(outcome)}")
    fault = _wrong_flight(flown, outcome)
    there = RowVerdict(False, f"{outcome.step}: {fault}") if fault else _there(row, flown, outcome)
    return there if there.ok else RowVerdict(False, f"{there.output}{_other_goal(flown, outcome)}")


def _other_goal(flown: FlownMission, outcome: Outcome) -> str:
    """Return that a node shows, and so flies to, another goal than the accepted one; else nothing."""
    _, since = _shown(flown, outcome.step.at)
    shown = next((each.goal for each in since if each.state == "MOVING"), None)
    if shown is None or dist(astuple(shown), goal_of(outcome.step)) < _SAME:
        return ""
    return f"; safety/state shows the goal {shown.x:g} {shown.y:g} {shown.z:g}"


def _refused_from_the_first(flown: FlownMission) -> str:
    """Return that the first goal was refused, which the cage permits; empty if it was not."""
    for first in gotos(flown)[:1]:
        if not first.accepted and permits(flown, first):
            return f"{first.step}: {_refusal(first)}"
    return ""


def _there(row: RubricRow, flown: FlownMission, outcome: Outcome) -> RowVerdict:
    """Return the verdict on the end of the flight to a goal."""
    reach = row.within or flown.params.safety.acceptance_range
    away = distance(flown.poses[-1], goal_of(outcome.step))
    if away > reach:
        return RowVerdict(
            False,
            f"{outcome.step}: {away:.2f} m away from it at the end, more than {reach:g} m",
        )
    last = flown.states[-1].state if flown.states else "no state at all"
    if last != "HOVERING":
        return RowVerdict(False, f"{outcome.step}: there, but safety/state shows {last}")
    return RowVerdict(True, f"{outcome.step}: arrived, {away:.2f} m away")


def _wrong_flight(flown: FlownMission, outcome: Outcome) -> str:
    """Return what is wrong with the states of a flight to the last goal; empty if nothing is.

    They are MOVING until the vehicle is within the acceptance range, and HOVERING then.
    """
    reach, goal, at = flown.params.safety.acceptance_range, goal_of(outcome.step), outcome.step.at
    poses = flown.poses[first_at(flown.poses, at) :]
    inside = next((pose.stamp for pose in poses if distance(pose, goal) < reach), inf)
    _, since = _shown(flown, at)
    moving = hovering = -1.0
    for state in since:
        if state.state == "MOVING":
            if hovering >= 0:
                return f"safety/state showed MOVING at {state.stamp:.2f} s, after HOVERING"
            moving = max(moving, state.stamp)
        elif state.state == "HOVERING" and hovering < 0:
            if moving < 0:
                return "safety/state showed no MOVING"
            hovering = state.stamp
            pose = pose_at(flown.poses, hovering)
            away = distance(pose, goal)
            # The stamp may be that of the setpoint before.
            if away > reach + speed(pose) / SETPOINT.hz:
                return f"HOVERING {away:.2f} m from it; the acceptance range is {reach:g} m"
        elif state.state == "VERIFYING" and state.stamp > at + _SOON:
            return f"safety/state showed VERIFYING at {state.stamp:.2f} s"
    if moving < 0:
        return "safety/state showed no MOVING"
    if hovering > inside + _SOON:
        return f"HOVERING {hovering - inside:.1f} s after it was {reach:g} m away"
    return ""


def _transitions(_row: RubricRow, flown: FlownMission) -> RowVerdict:
    outcome = gotos(flown)[-1]
    if not outcome.accepted:
        return RowVerdict(False, f"{outcome.step}: {_refusal(outcome)}")
    before, since = _shown(flown, outcome.step.at)
    shown = [before]
    for state in since:
        if state.state != shown[-1]:
            shown.append(state.state)
    why = f"{outcome.step}: safety/state showed {', '.join(shown)}"
    return RowVerdict(shown == ["HOVERING", "VERIFYING", "MOVING", "HOVERING"], why)


def _answers_in_flight(row: RubricRow, flown: FlownMission) -> RowVerdict:
    *_, first, second = gotos(flown)
    if not first.accepted:
        return RowVerdict(False, f"{first.step}: {_refusal(first)}")
    if not second.accepted and not second.reason:
        return RowVerdict(False, f"{second.step}: refused without a reason")
    return _there(row, flown, second if second.accepted else first)


def _stops(row: RubricRow, flown: FlownMission) -> RowVerdict:
    shut = max(
        n for n, o in enumerate(flown.outcomes) if isinstance(o.step, CageStep) and o.step.on
    )
    step = flown.outcomes[shut].step
    *_, flight = gotos(flown, shut)
    if not flight.accepted:
        return RowVerdict(False, f"{flight.step}: {_refusal(flight)}")
    if speed(pose_at(flown.poses, step.at)) < AT_REST:
        return RowVerdict(False, f"{step}: the vehicle was not on its way to {flight.step}")
    held = _stays_inside(row, flown)
    if not held.ok:
        return held
    if gotos(flown)[-1] is not flight:
        return _arrives(row, flown)
    last = flown.poses[-1]
    if flown.states and (shows := flown.states[-1].state) != "HOVERING":
        return RowVerdict(False, f"{step}: stopped, but safety/state shows {shows}")
    if speed(last) > AT_REST:
        return RowVerdict(
            False, f"{step}: the vehicle still moves {last.stamp - step.at:.1f} s later"
        )
    return RowVerdict(
        True, f"{step}: stopped inside, at {' '.join(f'{x:.2f}' for x in place_of(last))}"
    )


def _stays_inside(row: RubricRow, flown: FlownMission) -> RowVerdict:
    worst, at = excursion(flown)
    allowed = row.within or flown.margin
    text = f"{worst:.3g} m beyond the cage at {at:.1f} s"
    return RowVerdict(worst <= allowed, text if worst > 0 else "never beyond the cage")


def _answers(row: RubricRow, flown: FlownMission) -> RowVerdict:
    if fault := _refused_from_the_first(flown):
        return RowVerdict(False, fault)
    for step, reply, problem in flown.outcomes:
        service, _ = step.call()
        if row.service and service.name != row.service:
            continue
        name = str(step)
        if problem is not None:
            # Before the first reading there is no baseline.
            early = service is CALIBRATE and not _has_read(flown, step.at)
            if early or (service is GOTO and problem.message.strip()):
                continue
            return RowVerdict(False, f"{name}: {problem.message}")
        if isinstance(reply, GotoResponse) and not reply.accepted and not reply.reason.strip():
            return RowVerdict(False, f"{name}: refused without a reason")
        if isinstance(reply, ToggleCageResponse) and isinstance(step, CageStep):
            if not reply.success:
                return RowVerdict(False, f"{name}: success is false")
            # One that publishes on changes alone does so with the stamp of the pose before.
            shown = flown.states[: first_at(flown.states, step.at + _SOON)]
            if not shown or shown[-1].cage_on is not step.on:
                return RowVerdict(False, f"{name}: safety/state does not show it")
    fault = "" if row.service not in {"", CALIBRATE.name} else _wrong_baseline(row, flown)
    fault = fault or (_refused_none(flown) if row.service in {"", GOTO.name} else "")
    return RowVerdict(not fault, fault or "each request was answered")


def _refused_none(flown: FlownMission) -> str:
    """Return that no goal outside was refused, so that no reason was given; empty if one was, or none is outside."""
    outside = [outcome for outcome in gotos(flown) if not permits(flown, outcome)]
    if outside and all(outcome.accepted for outcome in outside):
        return f"{outside[0].step}: was accepted, so no refusal has a reason"
    return ""


def _wrong_baseline(row: RubricRow, flown: FlownMission) -> str:
    """Return which baseline is not the air's pressure, or does not change with it; empty if none is."""
    first: tuple[float, float] | None = None
    calls = [(o.step, o.reply) for o in flown.outcomes if isinstance(o.step, Calibrate)]
    for number, (step, reply) in enumerate(calls):
        if reply is None:
            continue
        air = 0.0 if step.unset else _air(flown, step.at)
        if abs(reply.baseline - air) > (row.within or _AIR):
            return f"{step}: baseline {reply.baseline:g} hPa, not {air:.2f} hPa"
        if step.unset and reply.baseline:
            return f"{step}: baseline {reply.baseline:g} hPa, not 0"
        if step.unset or not _has_read(flown, step.at):
            continue
        if not number and (fault := _not_read(flown, step, reply.baseline)):
            return fault
        first = first or (air, reply.baseline)
        change, expected = reply.baseline - first[1], air - first[0]
        if _is_off(change, expected, _ZERO):
            return f"{step}: {change:+.3f} hPa since the first baseline, not {expected:+.3f}"
    return ""


def _not_read(flown: FlownMission, step: Calibrate, baseline: float) -> str:
    """Return that a flight's first baseline is not what was read in the second before it; else nothing."""
    air = _air(flown, step.at)
    # Without those that are already zeroed, or still.
    raw = [r.pressure for r in flown.readings if step.at - 1 <= r.stamp < step.at]
    raw = [each for each in raw if abs(each - air) <= _AIR]
    # In a climb it matters by a reading where the second begins.
    if not raw or abs(baseline - fmean(raw)) <= _ZERO + _EDGE * (max(raw) - min(raw)):
        return ""
    return f"{step}: baseline {baseline:g} hPa; the mean of the last second is {fmean(raw):g} hPa"


_EDGE = 0.15
"""Share of a second's change by which its mean may differ: one and a half of its ten readings."""


def _has_read(flown: FlownMission, at: float) -> bool:
    """Return whether there was a reading of this flight before a time (s)."""
    return first_at(flown.readings, at) > 0


def _air(flown: FlownMission, at: float) -> float:
    """Return the pressure (hPa) of the standard atmosphere where the vehicle was at a time (s)."""
    return pressure_at(pose_at(flown.poses, at).position.z)


def _is_off(found: float, expected: float, base: float) -> bool:
    """Return whether a change (hPa) is not the expected one; the vehicle sways while a mean is taken."""
    return abs(found - expected) > base + _MODEL * abs(expected)


def _zeroed(row: RubricRow, flown: FlownMission) -> RowVerdict:
    calls = [(o.step, o.reply) for o in flown.outcomes if isinstance(o.step, Calibrate)]
    # A reading of the time of the next calibration may be from before it, or from after it.
    ends = [step.at - 1e-6 for step, _ in calls[1:]] + [flown.poses[-1].stamp]
    shown, offset = 0.0, None
    if (count := len(flown.readings)) > _MOST * PRESSURE.hz * flown.poses[-1].stamp:
        why = f"sensors/pressure shows {count} readings in {flown.poses[-1].stamp:g} s"
        return RowVerdict(False, f"{why}: {PRESSURE.hz:g} a second are expected")

    # Models of the air differ by an offset, which the last reading without a baseline has.
    for reading in flown.readings[: first_at(flown.readings, calls[0][0].at)][-1:]:
        offset = reading.pressure - _air(flown, reading.stamp)
    for (step, reply), end in zip(calls, ends, strict=True):
        if step.unset and reply and reply.baseline:
            return RowVerdict(False, f"{step}: baseline {reply.baseline:g} hPa, not 0")
        # The reading of the calibration's own period may have been on its way.
        after = [reading for reading in flown.readings if step.at + 0.1 < reading.stamp <= end]
        if not after and step is calls[-1][0]:
            return RowVerdict(False, f"sensors/pressure shows no reading after `{step}`")
        zero = _air(flown, step.at)
        for reading in after:
            shown, air = reading.pressure, _air(flown, reading.stamp)
            level, base = 0.0, row.within or _ZERO
            if step.unset:
                offset = shown - air if offset is None else offset
                level, base = zero + offset, _ZERO
            if abs((step.unset and offset) or 0) > _AIR or _is_off(shown - level, air - zero, base):
                return RowVerdict(
                    False,
                    f"sensors/pressure shows {shown:g} hPa {reading.stamp - step.at:.1f} s after"
                    f" `{step}`, not {level + air - zero:.6g}",
                )
    return RowVerdict(True, f"sensors/pressure shows {shown:+.6f} hPa")


def _parameter_obeyed(_row: RubricRow, flown: FlownMission) -> RowVerdict:
    cage = Commanded(flown)
    for number, outcome in enumerate(flown.outcomes):
        if not isinstance(outcome.step, GotoStep):
            continue
        permitted = cage.permits(number, outcome.step)
        if outcome.accepted is not permitted:
            verdict = "accepted" if outcome.accepted else _refusal(outcome)
            return RowVerdict(False, f"{outcome.step}: was {verdict}, with {cage.text(number)}")
        if not permitted and (fault := _wrong_refusal(flown, outcome)):
            return RowVerdict(False, f"{outcome.step}: {fault}")
    return RowVerdict(True, f"each verdict is that of {cage.text(-1)}")


def _state_seen(row: RubricRow, flown: FlownMission) -> RowVerdict:
    if not flown.states:
        return RowVerdict(False, "safety/state showed nothing")
    seen = sorted({state.state for state in flown.states})
    # A state that is missing inside the flight and states that end early have different causes.
    count, last = len(flown.states), flown.states[-1].stamp
    why = f"safety/state showed {', '.join(seen)}: {count} states, the last at {last:.2f} s"
    return RowVerdict(row.state in seen, why)


def random_flight(flown: FlownMission) -> RowVerdict:
    """Return the campaign's verdict: never beyond the cage, and each goal rightly answered."""
    cage, asked = Commanded(flown), -inf
    place: tuple[float, float, float] | None = (0.0, 0.0, flown.params.safety.takeoff)
    since = 0.0
    for number, outcome in enumerate(flown.outcomes):
        step = outcome.step
        name = f"{step} at {step.at:.2f} s"
        if outcome.problem is not None and not isinstance(outcome.problem, Refused):
            return RowVerdict(False, f"{name}: {outcome.problem.message}")
        shut = isinstance(step, CageStep) and step.on
        if place is not None and shut and not cage.permits(number, GotoStep(step.at, *place)):
            place, since = None, step.at
        if not isinstance(step, GotoStep):
            continue
        permitted = cage.permits(number, step)
        if outcome.accepted:
            if not permitted:
                return RowVerdict(False, f"{name}: was accepted with {cage.text(number)}")
            place, since = goal_of(step), step.at
        else:
            idle = step.at - _rests(flown, place, since)
            # One that verifies in its loop is busy for a moment with the goal before.
            if permitted and idle > _BUSY and step.at > asked + _SOON:
                return RowVerdict(
                    False,
                    f"{name}: was {_refusal(outcome)}; it was at rest, or had to be, for {idle:.1f} s",
                )
            if fault := _flown_all_the_same(flown, outcome):
                return RowVerdict(False, f"{name}: {fault}")
        asked = step.at
    worst, at = excursion(flown)
    if worst > flown.margin:
        return RowVerdict(False, f"the vehicle was {worst:.2f} m beyond the cage at {at:.2f} s")
    last = flown.poses[-1]
    if place is not None and last.stamp >= since + time_to_arrive(flown, place, since):
        away = distance(last, place)
        if away > flown.params.safety.acceptance_range:
            goal = " ".join(f"{x:g}" for x in place)
            return RowVerdict(False, f"goto {goal} at {since:.2f} s: never arrived")
    return RowVerdict(True, "inside, and each goal rightly answered")


_JUDGES = {
    "refused": _refused,
    "arrives": _arrives,
    "transitions": _transitions,
    "answers_in_flight": _answers_in_flight,
    "stays_inside": _stays_inside,
    "stops": _stops,
    "answers": _answers,
    "zeroed": _zeroed,
    "parameter_obeyed": _parameter_obeyed,
    "state_seen": _state_seen,
    "prints": lambda row, flown: prints(row, flown.log),
    "takes_waypoints": takes_waypoints,
    "replies": replies,
}


def _refusal(outcome: Outcome) -> str:
    return f"refused, {outcome.reason or 'without a reason'}"


def _rests(flown: FlownMission, place: tuple[float, float, float] | None, since: float) -> float:
    """Return when (s) the vehicle was there after it had set out, or had stopped if there is no place.

    It counts as there after the time for that: a vehicle that never rests is not busy for ever.
    """
    reach = flown.params.safety.acceptance_range
    for pose in flown.poses[first_at(flown.poses, since) :]:
        if speed(pose) < AT_REST if place is None else distance(pose, place) < reach:
            return pose.stamp
    return since + time_to_arrive(flown, place, since)
