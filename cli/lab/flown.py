"""Flown mission of a student's nodes, the witness of it, and the cage that it commanded. Pure."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping, Sequence
from math import dist
from typing import Any, ClassVar, NamedTuple

from msgspec.structs import astuple

from quadctl.cli.mission.mission import CageStep, GotoStep, ParamStep, Row
from quadctl.schemas.messages import CageSize, Pose, Pressure, SafetyState, Setpoint
from quadctl.schemas.params import Params
from quadctl.schemas.services import GotoResponse, SetParamsResponse
from quadctl.schemas.topics import POSE, PRESSURE, SETPOINT, STATE, Topic
from quadctl.services.airspace.airworthiness import stopping_law, wind_margin
from quadctl.services.airspace.geometry import Point, place_of
from quadctl.services.airspace.stopping import AT_REST, leeway, outside
from quadctl.services.airspace.zones import Region
from quadctl.services.campaign.score import inside
from quadctl.services.runtime.errors import QuadctlError


class Outcome(NamedTuple):
    """Step of a mission, and the answer to it: a reply or a problem."""

    step: Row
    reply: Any
    problem: QuadctlError | None

    @property
    def accepted(self) -> bool:
        """Return whether a goal was accepted."""
        return isinstance(self.reply, GotoResponse) and self.reply.accepted

    @property
    def reason(self) -> str:
        """Return why a goal was refused, by a reply or by an error reply."""
        reason: str = self.problem.message if self.problem is not None else self.reply.reason
        return reason.strip()


class FlownMission(NamedTuple):
    """Flight in one boot: parameters of the launch, answers, and every message, in order.

    `log` has the lines that the node has logged since its start, for a row about them.
    """

    params: Params
    outcomes: Sequence[Outcome]
    poses: Sequence[Pose]
    states: Sequence[SafetyState]
    readings: Sequence[Pressure]
    setpoints: Sequence[Setpoint] = ()
    log: Sequence[str] = ()

    @property
    def margin(self) -> float:
        """Return the margin in force (m) in the wind of the launch."""
        flies = self.params.dynamics
        return self.params.safety.margin + wind_margin(flies.vehicle, flies.control, flies.wind)


def gotos(flown: FlownMission, end: int | None = None) -> list[Outcome]:
    """Return the goals and the answers to them, up to the outcome of number `end`."""
    return [each for each in flown.outcomes[:end] if isinstance(each.step, GotoStep)]


def goal_of(step: Any) -> Point:
    """Return the goal (m) of a step."""
    return step.x, step.y, step.z


def speed(pose: Pose) -> float:
    """Return the speed (m/s) of a pose."""
    return dist(astuple(pose.velocity), (0, 0, 0))


def distance(pose: Pose, place: Iterable[float]) -> float:
    """Return the distance (m) of a pose from a place."""
    return dist(place_of(pose), tuple(place))


TIME_TO_ARRIVE = 10.0
"""Simulated seconds after which a random flight's last goal must be reached."""


def time_to_arrive(flown: FlownMission, place: Point | None, since: float) -> float:
    """Return the time (s) to reach a place from where the vehicle was at a time, or to stop.

    With the cage off, a right hand-in flies to a goal 10 km away, for as long as that takes.
    """
    begin = flown.poses[first_at(flown.poses, since) :][:1]
    if place is None or not begin:
        return TIME_TO_ARRIVE
    way = distance(begin[0], place)
    return max(TIME_TO_ARRIVE, 2 * way / flown.params.dynamics.control.max_speed)


def _stamp(message: Pose | SafetyState | Pressure) -> float:
    return message.stamp


def first_at(
    messages: Sequence[Pose] | Sequence[SafetyState] | Sequence[Pressure], at: float
) -> int:
    """Return the number of the first message of a time (s) or later."""
    return bisect_left(messages, at - 1e-9, key=_stamp)


def pose_at(poses: Sequence[Pose], at: float) -> Pose:
    """Return the pose at a time (s), or the next."""
    return poses[min(first_at(poses, at), len(poses) - 1)]


def until(flown: FlownMission, at: float) -> FlownMission:
    """Return what was flown up to a time (s)."""
    poses, states = flown.poses[: first_at(flown.poses, at) + 1], flown.states
    return flown._replace(poses=poses, states=states[: first_at(states, at)])


def excursion(flown: FlownMission) -> tuple[float, float]:
    """Return the worst way (m) beyond the cage in force, more than permitted, and its time (s).

    A vehicle outside, or about to leave, when the cage comes on may go as far as it needs to stop,
    and never out again once it has come nearer.
    """
    cage = Commanded(flown)
    flies = flown.params.dynamics
    braking = flies.control.max_acceleration
    law = stopping_law(flies.vehicle, flies.control, flies.wind)
    worst, at, allowed = 0.0, 0.0, 0.0
    before: Point | None = None
    for pose in flown.poses:
        size = cage.in_force(pose.stamp)
        if size is not None:
            p, v = place_of(pose), (pose.velocity.x, pose.velocity.y, pose.velocity.z)
            if size != before:
                sx, sy, sz = (x + 0.5 / braking * u * abs(u) for x, u in zip(p, v, strict=True))
                room = max(outside(*p, *size), outside(sx, sy, sz, *size))
                allowed = leeway(pose, CageSize(*size), Region(), law) if room > 0 else 0.0
            out = outside(*p, *size)
            if out - allowed > worst:
                worst, at = out - allowed, pose.stamp
            if allowed and dist(v, (0, 0, 0)) < AT_REST:
                allowed = min(allowed, out)
        before = size
    return worst, at


class Commanded:
    """Cage as the mission commands it, whatever the node makes of it."""

    def __init__(self, flown: FlownMission) -> None:
        size = flown.params.safety.virtual_cage
        now = (size.x, size.y, size.z), flown.params.safety.cage_on
        self._launch = now[0] if now[1] else None
        self._times: list[float] = []
        self._after: list[Point | None] = []
        for step, reply, problem in flown.outcomes:
            now = _changed(now, step, reply, problem)
            self._times.append(step.at)
            self._after.append(now[0] if now[1] else None)

    def in_force(self, at: float) -> Point | None:
        """Return the bounds (m) at a time (s), None if the cage is off."""
        passed = bisect_right(self._times, at)
        return self._after[passed - 1] if passed else self._launch

    def permits(self, number: int, step: GotoStep) -> bool:
        """Return whether a goal may be flown to; `number` is that of its outcome, for equal times."""
        return _permits(self._after[number], step)

    def permits_at(self, at: float, step: Any) -> bool:
        """Return whether a place may be flown to at a time (s)."""
        return _permits(self.in_force(at), step)

    def text(self, number: int) -> str:
        """Return the cage at an outcome, for a message."""
        size = self._after[number]
        return "the cage off" if size is None else f"a cage of {' '.join(f'{s:g}' for s in size)}"


def _permits(size: Point | None, step: Any) -> bool:
    return bool(step.z >= 0) if size is None else inside(goal_of(step), size)


def _changed(now: tuple[Point, bool], step: Row, reply: Any, problem: Any) -> tuple[Point, bool]:
    """Return the cage's size, and whether it is on, after a step."""
    (x, y, z), on = now
    if isinstance(step, CageStep):
        return (x, y, z), step.on
    if isinstance(step, ParamStep) and isinstance(reply, SetParamsResponse):
        bounds = {"x": x, "y": y, "z": z}
        for name, value in step.values.items() if reply.success and problem is None else ():
            if name.startswith("safety.virtual_cage."):
                bounds[name[-1]] = float(value)
        x, y, z = bounds.values()
    return (x, y, z), on


def permits(flown: FlownMission, outcome: Outcome) -> bool:
    """Return whether the cage that was commanded permits a goal."""
    return Commanded(flown).permits(flown.outcomes.index(outcome), outcome.step)  # type: ignore[arg-type]


_DUE = round(POSE.hz / SETPOINT.hz)
"""Poses from one that safety answers to the next."""
_SLACK = 1e-6
"""Seconds of rounding of a time."""
_MOST_A_SECOND = 1000
"""Messages of a topic, in a simulated second, that are kept; a node publishes 10 or 20, or 100 where
it answers each pose at once."""


class Witness:
    """Every message of one boot up to a time (s)."""

    topics: ClassVar[tuple[Topic[Any], ...]] = (POSE, STATE, PRESSURE, SETPOINT)

    def __init__(self, boot: str, end: float) -> None:
        self.stamp = -1.0
        self.poses: list[Pose] = []
        self.states: list[SafetyState] = []
        self.readings: list[Pressure] = []
        self.setpoints: list[Setpoint] = []
        self._boot, self._end, self._count = boot, end, 0

    def add(self, message: Pose | SafetyState | Pressure | Setpoint) -> None:
        """Take a message; raise QuadctlError for a pose that is missing or not from dynamics."""
        if isinstance(message, Pose):
            if message.boot == self._boot:
                self._add(message)
        elif isinstance(message, SafetyState):
            if message.boot == self._boot and message.stamp <= self._end + _SLACK:
                self.states.append(message)
                self._check_count(STATE, len(self.states), SETPOINT.hz)
        elif isinstance(message, Setpoint):
            if message.boot == self._boot and message.for_seq <= self._end * POSE.hz:
                self.setpoints.append(message)
                self._check_count(SETPOINT, len(self.setpoints), SETPOINT.hz)
        elif message.stamp <= self._end + _SLACK:
            # A reading has no boot: those of its time or later belong to the one before.
            while self.readings and self.readings[-1].stamp >= message.stamp:
                self.readings.pop()
            self.readings.append(message)
            self._check_count(PRESSURE, len(self.readings), PRESSURE.hz)

    def check(self, _values: Mapping[str, Any], _changes: Iterable[Any]) -> None:
        """Raise QuadctlError if the flight has not reached its end."""
        if self.stamp < self._end - _SLACK:
            raise QuadctlError(f"the flight ended at {self.stamp:g} s of {self._end:g} s")

    def unanswered(self) -> str:
        """Return which pose safety has not answered, so that time stands still; empty if it has."""
        due = max((pose.seq for pose in self.poses if not pose.seq % _DUE), default=-1)
        last = max((setpoint.for_seq for setpoint in self.setpoints), default=-1)
        if last >= due:
            return ""
        answered = f"the last one was for pose {last}" if last >= 0 else "none has come"
        return f"safety owes a setpoint for pose {due}: {answered}"

    def _check_count(self, topic: Topic[Any], count: int, expected: float) -> None:
        if count > _MOST_A_SECOND * (self._end + 1):
            raise QuadctlError(
                f"{topic.node} published {count} messages on {topic.name} until"
                f" {max(self.stamp, 0):g} s: {expected:g} a second are expected"
            )

    def _add(self, pose: Pose) -> None:
        count = self._count
        # In lock-step an unanswered pose is published again; each comes once from dynamics.
        if pose.seq < count and (pose.seq >= len(self.poses) or pose == self.poses[pose.seq]):
            return
        if pose.seq != count:
            raise QuadctlError(
                f"pose {pose.seq} came {'twice, and differs' if pose.seq < count else 'too early'}:"
                " dynamics alone may publish poses"
            )
        self.stamp, self._count = pose.stamp, count + 1
        # The vehicle flies on until the last node has reached the end: how far is chance.
        if pose.stamp <= self._end + _SLACK:
            self.poses.append(pose)
