"""One vehicle of a running system, for programs; the commands and the console use the same calls.

quad.goto(1, 2, 1)                      # waits for the arrival
flight = quad.goto(2, 2, 1, wait=False)
flight.wait()
"""

import math
import reprlib
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from numbers import Real
from typing import TYPE_CHECKING, Any, Generic, Literal, Self, TypeVar, overload
from weakref import finalize

import msgspec
from msgspec import Struct

from quadctl.schemas.messages import PAUSED, WAITS, Pose, Position, Pressure, SafetyState
from quadctl.schemas.services import (
    CalibrateRequest,
    GetParamsRequest,
    GotoRequest,
    HoldRequest,
    ResetRequest,
    ToggleCageRequest,
)
from quadctl.schemas.topics import (
    CALIBRATE,
    GOTO,
    HOLD,
    POSE,
    PRESSURE,
    RESET,
    STATE,
    TOGGLE_CAGE,
    TOPICS,
    Service,
    Topic,
    get_params,
)
from quadctl.schemas.typed import converted
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import Invalid, QuadctlError, Refused, TimedOut
from quadctl.services.runtime.typed import plain, positive_time, require

if TYPE_CHECKING:
    from quadctl.parameters import ParamTable
    from quadctl.services.runtime.bus.streams import TypedSubscriber

M = TypeVar("M", bound=Struct)

_SLACK = 5.0
"""Seconds that a flight may take beyond twice the planned time."""


_STATES_MISSED = 3
"""Periods of safety's state without one that can be read, after which a flight is given up."""
_LONGEST_WAIT = 1.0
"""Seconds of one wait in a watch, which ends when its connection is closed."""


class Calibration(Struct, frozen=True):
    """Baseline of the barometer, hPa: the mean of so many samples, and their spread (hPa)."""

    baseline: float
    samples: int
    spread: float


class Arrival(Struct, frozen=True):
    """End of a flight: the distance left to the goal (m), and the simulated seconds it took."""

    distance: float
    seconds: float


def distance(a: Position, b: Position) -> float:
    """Return the metres between two points."""
    return math.dist((a.x, a.y, a.z), (b.x, b.y, b.z))


def goal_of(
    x: float,
    y: float,
    z: float,
    *,
    replace: bool = False,
    direct: bool = False,
    wait: bool = False,
) -> GotoRequest:
    """Return a request for a point, m; raise Invalid for a bad coordinate.

    Numbers of NumPy count as numbers; True and texts do not.
    """
    point = {axis: _metres(axis, value) for axis, value in (("x", x), ("y", y), ("z", z))}
    how = {"replace": replace, "direct": direct, "wait": wait}
    try:
        return converted(point | how, GotoRequest)
    except msgspec.ValidationError as error:
        axis = str(error).rpartition("$.")[2].rstrip("`")
        if axis not in point:
            raise Invalid(f"{axis} = {how[axis]!r} is not valid", "give True or False") from None
        raise _bad_coordinate(axis, f"{point[axis]:g}") from None


def _metres(axis: str, value: object) -> float:
    """Return a coordinate as a plain float, which NumPy's numbers are not; raise Invalid for others."""
    value = plain(value)  # an array of one number, too
    if not isinstance(value, bool) and isinstance(value, Real):
        try:
            return float(value)
        except OverflowError:
            pass  # an int with more than 308 digits
    raise _bad_coordinate(axis, reprlib.repr(value))


def _bad_coordinate(axis: str, value: str) -> Invalid:
    return Invalid(
        f"{axis} = {value} is not a valid coordinate",
        "coordinates are metres, finite, and at most 10 km from the origin",
    )


def patience(client: Client, metres: float) -> float:
    """Return the time (s) to wait for an arrival: twice the planned time, and 5.

    The plan is an upper bound of a flight from rest to rest within the setpoint's limits.
    """
    reply = client.call(get_params("dynamics"), GetParamsRequest(["dynamics.control"]))
    values = reply.values | reply.in_force
    speed, acceleration, jerk = (
        float(values[f"dynamics.control.max_{name}"]) for name in ("speed", "acceleration", "jerk")
    )
    planned = metres / speed + speed / acceleration + acceleration / jerk
    return 2 * planned + _SLACK


_RESTS, _AT_REST = 0.05, 0.25
"""Speed (m/s) of a vehicle that rests, and the simulated seconds of it: one that turns is slow, too."""
_SETTLED = 1.0
"""Simulated seconds at rest of a settled vehicle: `calibrate` averages the last second."""
_SETTLING = 30.0
"""Seconds for a vehicle to rest after its arrival."""
_LOOK = 0.02
"""Seconds between two looks at safety's state."""


def speed(pose: Pose) -> float:
    """Return the speed of a vehicle, m/s."""
    return math.hypot(pose.velocity.x, pose.velocity.y, pose.velocity.z)


def slowed(client: Client, below: float, timeout: float, lasting: float = 0.0) -> Pose | None:
    """Return the first pose slower than so many m/s for so long (simulated s); None after `timeout` s.

    Raises Client.silent's error if poses stop.
    """
    poses, ends = client.subscribe(POSE), time.monotonic() + timeout
    since = math.inf
    try:
        while time.monotonic() < ends:
            pose = poses.next(client.timeout)
            if pose is None:
                raise client.silent(POSE.key(client.vehicle), poses.problem)
            since = min(since, pose.stamp) if speed(pose) < below else math.inf
            if pose.stamp - since >= lasting:
                return pose
        return None
    finally:
        poses.close()


def restless(timeout: float, since: str = "") -> TimedOut:
    """Return the error for a vehicle that does not come to rest within `timeout` s."""
    return TimedOut(
        f"the vehicle does not rest within {timeout:g} s{since}",
        "is there wind? `quadctl param get dynamics.wind`",
    )


def hint_for(reason: str, request: GotoRequest, offers: Collection[str]) -> str:
    """Return what to do about a goal that safety refused for this reason.

    `offers` are the vehicle's keys that a node offers: a student's node may not serve all of ours,
    and what the request has tried already is no remedy.
    """
    ways: list[str] = []
    if reason.startswith("busy"):
        ways += [] if request.replace else ["`--replace` changes course"]
        ways += ["`quadctl hold` stops"] if _is_offered(HOLD, offers) else []
        return "; ".join(ways) or "`quadctl state --watch` shows when the vehicle has arrived"
    if reason.startswith("separation"):
        ways += [] if request.wait else ["`--wait` waits until a vehicle that flies has passed"]
        return "; ".join([*ways, "`quadctl fleet list` shows all"])
    return "`quadctl cage show` and `quadctl state` show more"


def _is_offered(service: Service[Any, Any], offers: Collection[str]) -> bool:
    return any(key.endswith(f"/@srv/{service.name}") for key in offers)


def hovers(state: SafetyState) -> bool:
    """Return whether safety holds the vehicle at its goal, and no paused flight is to go on."""
    return (
        bool(state.boot)
        and state.state == "HOVERING"
        and not state.reason.startswith((PAUSED, WAITS))
    )


class Flight:
    """One flight to a goal, from safety's verdict on it to its end.

    `accepted` and `reason` are the verdict; `reason` is also why an accepted flight was stopped,
    and `paused` why it waits, e.g. for poses that are late, or for another vehicle.
    """

    def __init__(self, client: Client, request: GotoRequest, timeout: float | None = None) -> None:
        """Request the goal; raise what Client.call raises. `timeout` (s) is for the verdict."""
        self._client, self._request = client, request
        self._goal = Position(request.x, request.y, request.z)
        self._is_held = False
        self._arrived, self._reason = False, ""
        self._distance, self._seconds = math.inf, 0.0
        self._began: float | None = None
        self._moving, self._state_at = False, time.monotonic()
        topics: tuple[Topic[Any], ...] = (STATE, POSE)
        # Before the request, so that no message is missed.
        self._messages: TypedSubscriber[Any] = client.subscribe(*topics)
        self._end = finalize(self, self._messages.close)
        reply = client.call(GOTO, request, timeout)
        self.accepted = reply.accepted
        self.paused = reply.reason if reply.accepted else ""
        if not reply.accepted:
            self._reason = reply.reason
            self._end()

    def __repr__(self) -> str:
        goal = f"({self._goal.x:g}, {self._goal.y:g}, {self._goal.z:g})"
        if not self.accepted:
            return f"<flight to {goal}, refused: {self._reason}>"
        self._catch_up()
        end = "arrived" if self._arrived else f"stopped: {self._reason}" if self._reason else ""
        return f"<flight to {goal}, {end or self.paused or 'under way'}>"

    @property
    def reason(self) -> str:
        """Return why the goal was refused, or the flight stopped; else an empty string."""
        self._catch_up()
        return self._reason

    @property
    def arrived(self) -> bool:
        """Return whether the vehicle has arrived."""
        self._catch_up()
        return self._arrived

    @property
    def distance(self) -> float:
        """Return the metres to the goal; infinite before the first pose."""
        self._catch_up()
        return self._distance

    @property
    def seconds(self) -> float:
        """Return the simulated seconds of the flight so far."""
        self._catch_up()
        return self._seconds

    def begin(self) -> float:
        """Wait for a pose, or an earlier stop, and return the metres to go.

        Raises Client.silent's error if none comes.
        """
        self._check_open()
        deadline = time.monotonic() + self._client.timeout
        while self._began is None and not self._is_over:
            message = self._messages.next(deadline - time.monotonic())
            if message is None:
                raise self._client.silent(POSE.key(self._client.vehicle), self._messages.problem)
            self._take(message)
        return self._distance

    def leave(self) -> None:
        """Wait until a goal that waits for other vehicles is flown to, or dropped; raises as `wait`."""
        self.begin()
        while self.paused.startswith(WAITS) and not self._is_over:
            message = self._messages.next(self._client.timeout)
            if message is None:
                raise self._client.silent(STATE.key(self._client.vehicle), self._messages.problem)
            self._take(message)

    def wait(
        self,
        timeout: float | None = None,
        on_progress: Callable[[float], None] | None = None,
        on_pause: Callable[[str], None] = lambda _reason: None,
    ) -> Arrival:
        """Wait for the arrival for up to `timeout` s, by default twice the planned time and 5 s.

        While the goal waits for other vehicles, this time does not pass. The default counts on the clock
        and in simulated time, which may be slower.
        `on_progress` is called with the metres to go, `on_pause` with the reason when the flight
        pauses, and with "" when it goes on. Raises Refused if the goal was refused or the flight
        stopped, TimedOut if it takes longer, Invalid if safety's states cannot be read, and
        Client.silent's error if messages stop.
        """
        if timeout is not None:
            timeout = positive_time("timeout", timeout)
        metres = self.begin()
        counted = math.inf  # simulated seconds so far, where they count, too
        if timeout is None:
            timeout, counted = 0.0 if self._is_over else self._patience(metres), 0.0
        ends = time.monotonic() + timeout
        if self.paused:
            on_pause(self.paused)
        while not self._is_over:
            if self.paused.startswith(WAITS):
                ends = time.monotonic() + timeout
            # A simulation that stands still gives no more time.
            if counted < self._seconds < timeout:
                counted = self._seconds
                ends = max(ends, time.monotonic() + 2 * self._client.timeout)
            left = ends - time.monotonic()
            if left <= 0:
                raise TimedOut(
                    f"not there after {timeout:.1f} s: {self._distance:.2f} m to go",
                    f"{self.goes_on()}; --arrive (in Python timeout=) waits longer",
                )
            message = self._messages.next(min(left, self._client.timeout))
            self._check_open()
            if message is not None:
                before = self.paused
                self._take(message)
                if self.paused != before:
                    on_pause(self.paused)
                if on_progress is not None:
                    on_progress(self._distance)
                self._check_states()
            elif left > self._client.timeout:
                raise self._client.silent(STATE.key(self._client.vehicle), self._messages.problem)
        if self._reason:
            raise self.refusal()
        return Arrival(self._distance, self._seconds)

    def _patience(self, metres: float) -> float:
        """Return the time (s) to wait by default, with so many metres to go."""
        return patience(self._client, metres)

    def _check_open(self) -> None:
        """Raise Unreachable if the connection was closed during the flight: nothing comes any more."""
        if not self._is_over:
            self._client.session  # noqa: B018 - raises

    def _check_states(self) -> None:
        """Raise Invalid if safety's states cannot be read: poses alone report no end of a flight."""
        problem = self._messages.unread.get(STATE.key(self._client.vehicle))
        silence = time.monotonic() - self._state_at
        if problem and silence > max(self._client.timeout, _STATES_MISSED / STATE.hz):
            raise problem

    def settle(self, timeout: float = _SETTLING) -> Arrival:
        """Wait, after the arrival, until the vehicle rests; raise TimedOut after `timeout` s."""
        timeout = positive_time("timeout", timeout)
        pose = slowed(self._client, _RESTS, timeout, _AT_REST)
        if pose is None:
            raise restless(timeout, " of its arrival")
        self._distance = distance(pose.position, self._goal)
        self._seconds = pose.stamp - (self._began or 0.0)
        return Arrival(self._distance, self._seconds)

    def refusal(self) -> Refused:
        """Return the error for a goal that was refused, or a flight that was stopped."""
        if self.accepted:
            text = f"the flight was stopped: {self._reason}" if self._reason else "it is under way"
            return Refused(text, "`quadctl state` shows more", reason=self._reason)
        hint = hint_for(self._reason, self._request, self._offers())
        return Refused(self._reason, hint, reason=self._reason)

    def goes_on(self) -> str:
        """Return the text for a flight that nobody waits for any more, with the way to stop it."""
        stop = _is_offered(HOLD, self._offers())
        return "the flight goes on" + ("; `quadctl hold` stops it" if stop else "")

    def _offers(self) -> set[str]:
        with suppress(QuadctlError):
            return {offer.key for offer in self._client.endpoints("@srv")}
        return set()

    @property
    def _is_over(self) -> bool:
        # At a goal nearby the vehicle may have arrived before the first pose comes.
        return (self._arrived and self._began is not None) or bool(self._reason)

    def _catch_up(self) -> None:
        while not self._is_over and (message := self._messages.next(0)) is not None:
            self._take(message)

    def _take(self, message: Pose | SafetyState) -> None:
        self._read(message)
        if self._is_over:
            self._end()

    def _read(self, message: Pose | SafetyState) -> None:
        if isinstance(message, Pose):
            if self._began is None:
                self._began = message.stamp
            self._distance = distance(message.position, self._goal)
            self._seconds = message.stamp - self._began
        else:
            self._state_at = time.monotonic()
            self._follow(message)

    def _follow(self, state: SafetyState) -> None:
        if not state.boot:
            # Safety has restarted and has seen no pose; its next states report the outcome.
            return
        if self._moving and state.reason.startswith(PAUSED):
            self.paused = state.reason
            return
        if not self._moving and state.reason.startswith(WAITS):
            self.paused, self._is_held = state.reason, True
            return
        if self._is_held and not self._moving and state.state == "HOVERING":
            self._reason = state.reason or "the goal waits no more"
        elif state.goal == self._goal:
            self.paused = ""
            self._moving = self._moving or state.state == "MOVING"
            self._arrived = self._moving and state.state == "HOVERING"
        elif self._moving and state.state != "VERIFYING":
            other = "another goal was accepted in its place"
            elsewhere = "safety holds the vehicle elsewhere"
            self._reason = state.reason or (other if state.state == "MOVING" else elsewhere)


class Watch(Generic[M]):
    """Iterator over a topic's messages as they come, for so many seconds of the reader's clock.

    Of unread messages the oldest beyond 10 000 are dropped, and `lost` counts them. Raises
    Client.silent's error if the hub, or the publisher of a topic with a rate, is silent for longer
    than the client's timeout.
    """

    def __init__(self, client: Client, topic: Topic[M], seconds: float) -> None:
        require(topic, Topic, "POSE of quadctl.schemas.topics")
        self._client, self._topic = client, topic
        self._ends = time.monotonic() + positive_time("seconds", seconds)
        self._messages: TypedSubscriber[M] = client.subscribe(topic)
        self._end = finalize(self, self._messages.close)

    def __repr__(self) -> str:
        return f"<watch of {self._topic.name} of {self._client.vehicle}, {self.lost} lost>"

    def _check_silence(self, seconds: float) -> None:
        client, key = self._client, self._topic.key(self._client.vehicle)
        if seconds <= client.timeout:
            return
        # A topic without a rate may be silent, and one of a slow simulation comes late.
        if client.is_connected and (
            not self._topic.hz or any(offer.key == key for offer in client.endpoints("@pub"))
        ):
            return
        raise client.silent(key, self._messages.problem)

    @property
    def lost(self) -> int:
        """Return the number of messages that were dropped unread."""
        return self._messages.lost

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> M:
        since = time.monotonic()
        while (left := self._ends - time.monotonic()) > 0:
            self._client.session  # noqa: B018 - raises if nothing can come any more
            message = self._messages.next(min(left, _LONGEST_WAIT))
            if message is not None:
                return message
            self._check_silence(time.monotonic() - since)
        if not self._client.is_connected:
            self._check_silence(math.inf)
        self._end()
        raise StopIteration


class Vehicle:
    """One vehicle of a running system.

    Each method raises Unreachable if nobody answers, TimedOut if an answer takes longer than the
    connection's timeout, and Invalid for an unreadable message; metres, seconds, ENU.
    """

    def __init__(self, client: Client) -> None:
        self.client = client

    def __repr__(self) -> str:
        return f"<{type(self).__name__.lower()}: {self.client!r}>"

    @property
    def name(self) -> str:
        """Return the vehicle's name."""
        return self.client.vehicle

    def calibrate(self, *, unset: bool = False) -> Calibration:
        """Zero the barometer at the mean of its last second, or drop the baseline.

        Raises NotReady if the barometer had no reading in that second.
        """
        if unset:
            baseline = self.client.call(CALIBRATE, CalibrateRequest(zero=False)).baseline
            return Calibration(baseline, 0, 0.0)
        readings = self.client.subscribe(PRESSURE)
        try:
            baseline = self.client.call(CALIBRATE, CalibrateRequest(zero=True)).baseline
            deadline = time.monotonic() + self.client.timeout
            # The first message with the baseline also has its samples and spread.
            while (reading := readings.next(deadline - time.monotonic())) is not None:
                if reading.baseline == baseline:
                    return Calibration(baseline, reading.samples, reading.spread)
                if time.monotonic() > deadline:
                    break
            raise self.client.silent(PRESSURE.key(self.name), readings.problem)
        finally:
            readings.close()

    @overload
    def goto(
        self, x: float, y: float, z: float, *,
        replace: bool = ..., direct: bool = ..., after_others: bool = ...,
        wait: Literal[True] = ..., settle: bool = ..., timeout: float | None = ...,
    ) -> Arrival: ...  # fmt: skip
    @overload
    def goto(
        self, x: float, y: float, z: float, *,
        replace: bool = ..., direct: bool = ..., after_others: bool = ...,
        wait: Literal[False], timeout: float | None = ...,
    ) -> Flight: ...  # fmt: skip

    def goto(
        self,
        x: float,
        y: float,
        z: float,
        *,
        replace: bool = False,
        direct: bool = False,
        after_others: bool = False,
        wait: bool = True,
        settle: bool = False,
        timeout: float | None = None,
    ) -> Arrival | Flight:
        """Fly to a point (m, ENU); return its Arrival, or without `wait` the Flight.

        With `settle` also wait until the vehicle rests. `replace` changes course while flying to
        another goal, `direct` refuses rather than fly around zones, and with `after_others` the goal
        waits until other vehicles have left its way. Raises Refused, with the reason, if safety
        refuses the goal or stops the flight, Invalid for a bad coordinate, and TimedOut after
        `timeout` (s; default: twice the planned time and 5 s).
        """
        request = goal_of(x, y, z, replace=replace, direct=direct, wait=after_others)
        flight = Flight(self.client, request)
        if not flight.accepted:
            raise flight.refusal()
        if not wait:
            return flight
        arrival = flight.wait(timeout)
        return flight.settle() if settle else arrival

    def settle(self, timeout: float = _SETTLING) -> Pose:
        """Wait until the vehicle hovers and has rested for a second, and return its pose.

        A program begins with it after a launch: the vehicle still climbs, and a baseline of
        `calibrate` would be wrong. Raises TimedOut, with the cause, after `timeout` (s).
        """
        timeout = positive_time("timeout", timeout)
        ends = time.monotonic() + timeout
        # The latched state: a vehicle that hovers already may publish no other for a second.
        while not hovers(state := self.state()):
            if time.monotonic() > ends:
                why = f": {state.reason}" if state.reason else ""
                raise TimedOut(
                    f"the vehicle does not hover after {timeout:g} s: safety is {state.state}{why}",
                    "timeout= waits longer; `quadctl hold` stops a flight",
                )
            time.sleep(_LOOK)
        # Only now: on the ground the vehicle rests before its take-off, too.
        pose = slowed(self.client, _RESTS, ends - time.monotonic(), _SETTLED)
        if pose is None:
            raise restless(timeout)
        if pose.boot != state.boot:  # a reset in between, which safety has not seen yet
            return self.settle(max(ends - time.monotonic(), 0.0))
        return pose

    def hold(self) -> None:
        """Stop, and hover at the stopping point."""
        self.client.call(HOLD, HoldRequest())

    def reset(self) -> None:
        """Put the vehicle back at its start, as a new boot of the simulation."""
        self.client.call(RESET, ResetRequest())

    def cage(self, *, on: bool) -> None:
        """Turn the cage on or off; raise Refused if safety does not."""
        if not self.client.call(TOGGLE_CAGE, ToggleCageRequest(on)).success:
            raise Refused(
                f"safety did not turn the cage {'on' if on else 'off'}", "`quadctl state` shows why"
            )

    def pose(self) -> Pose:
        """Return the vehicle's next pose."""
        return self.client.first(POSE)

    def pressure(self) -> Pressure:
        """Return the barometer's next reading."""
        return self.client.first(PRESSURE)

    def state(self) -> SafetyState:
        """Return the automaton's present state."""
        return self.client.latest(STATE)

    @overload
    def watch(self, topic: Literal["pose"], seconds: float = ...) -> Watch[Pose]: ...
    @overload
    def watch(self, topic: Literal["pressure"], seconds: float = ...) -> Watch[Pressure]: ...
    @overload
    def watch(self, topic: Literal["state"], seconds: float = ...) -> Watch[SafetyState]: ...
    @overload
    def watch(self, topic: Topic[M], seconds: float = ...) -> Watch[M]: ...
    @overload
    def watch(self, topic: str, seconds: float = ...) -> Watch[Any]: ...

    def watch(self, topic: Any, seconds: float = math.inf) -> Watch[Any]:
        """Subscribe to a topic, and iterate over its messages for so many seconds.

        A topic is named in full or by its last word, e.g. `safety/state` or `state`. Raises Invalid
        for an unknown name.
        """
        return Watch(self.client, topic_named(topic) if isinstance(topic, str) else topic, seconds)

    @property
    def params(self) -> "ParamTable":
        """Return the parameters of the vehicle's nodes: read and set by dotted name."""
        from quadctl.parameters import ParamTable

        return ParamTable(self.client)


def topic_named(name: str) -> Topic[Any]:
    """Return a declared topic by its name or its last word; raise Invalid with the nearest."""
    bare = name.strip("/")
    for topic in TOPICS:
        if bare == topic.name or (
            bare == topic.name.rpartition("/")[2] and topic.name != "pose/slow"
        ):
            return topic
    from quadctl.services.runtime.params.names import nearest

    names = [topic.name for topic in TOPICS]
    raise Invalid(
        f"there is no topic {name:.80}",
        nearest(bare, names) or f"there are {', '.join(names)}",
    )
