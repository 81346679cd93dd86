"""`goto`: one flight, followed to its end."""

import math
import time
from typing import Annotated, Any

import msgspec

from quadctl.cli import context, output
from quadctl.cli.context import LONGEST_TIMEOUT, Options
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.progress import Progress
from quadctl.schemas.messages import PAUSED, Pose, Position, SafetyState
from quadctl.schemas.services import GetParamsRequest, GotoRequest, GotoResponse
from quadctl.schemas.topics import GOTO, POSE, STATE, Topic, get_params
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import Invalid, QuadctlError, Refused, TimedOut

_SLACK = 5.0
"""Seconds that a flight may take beyond twice the planned time."""


def distance(a: Position, b: Position) -> float:
    """Return the metres between two points."""
    return math.dist((a.x, a.y, a.z), (b.x, b.y, b.z))


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


class Flight:
    """One flight to a goal. Create it before requesting the goal, so that no message is missed."""

    def __init__(self, client: Client, goal: Position) -> None:
        self.arrived, self.reason, self.paused = False, "", ""
        self.distance, self.seconds = math.inf, 0.0
        self.goal, self._client = goal, client
        topics: tuple[Topic[Any], ...] = (STATE, POSE)
        self._readings = client.subscribe(*topics)
        self._began: float | None = None
        self._moving = False

    def begin(self) -> None:
        """Wait for the distance to go, or for an earlier stop; raise Client.silent's error."""
        deadline = time.monotonic() + self._client.timeout
        while self._began is None and not self.reason:
            message = self._readings.next(deadline - time.monotonic())
            if message is None:
                raise self._client.silent(POSE.key(self._client.vehicle), self._readings.unread)
            self._read(message)

    def watch(
        self, limit: float, on_progress: Any = None, on_pause: Any = lambda _reason: None
    ) -> None:
        """Follow the flight for up to `limit` s; call `on_progress` with the metres to go.

        `on_pause` is called with the reason when the flight pauses, and with "" when it goes on.
        Raises Refused if the flight was stopped, TimedOut if it does not arrive in time, and
        Client.silent's error if messages stop.
        """
        ends = time.monotonic() + limit
        while not (self.arrived or self.reason):
            left = ends - time.monotonic()
            if left <= 0:
                raise TimedOut(
                    f"not there after {limit:.1f} s: {self.distance:.2f} m to go",
                    "the flight goes on; `quadctl hold` stops it, --arrive waits longer",
                )
            message = self._readings.next(min(left, self._client.timeout))
            if message is not None:
                before = self.paused
                self._read(message)
                if self.paused != before:
                    on_pause(self.paused)
                if on_progress is not None:
                    on_progress(self.distance)
            elif left > self._client.timeout:
                raise self._client.silent(STATE.key(self._client.vehicle), self._readings.unread)
        if self.reason:
            raise Refused(f"the flight was stopped: {self.reason}", "`quadctl state` shows more")

    def _read(self, message: Pose | SafetyState) -> None:
        if isinstance(message, Pose):
            if self._began is None:
                self._began = message.stamp
            self.distance = distance(message.position, self.goal)
            self.seconds = message.stamp - self._began
            return
        if not message.boot:
            # Safety has restarted and has seen no pose; its next states report the outcome.
            return
        if self._moving and message.reason.startswith(PAUSED):
            self.paused = message.reason
            return
        if message.goal == self.goal:
            self.paused = ""
            self._moving = self._moving or message.state == "MOVING"
            self.arrived = self._moving and message.state == "HOVERING"
        elif self._moving and message.state != "VERIFYING":
            moving = message.state == "MOVING"
            other = "another goal was accepted in its place"
            self.reason = message.reason or (
                other if moving else "safety holds the vehicle elsewhere"
            )


def goto(
    options: Options,
    x: Annotated[float, Arg("East, m.")],
    y: Annotated[float, Arg("North, m.")],
    z: Annotated[float, Arg("Up, m.")],
    no_wait: Annotated[bool, Option("Return with safety's verdict.")] = False,
    replace: Annotated[bool, Option("Change course while flying to another goal.")] = False,
    arrive: Annotated[
        float | None, Option("Seconds to arrive in (default: twice the planned time and 5).")
    ] = None,
) -> None:
    """Fly to a point, if safety permits, and wait for the arrival.

    Example: quadctl goto 1 -2 1.5
    """
    check_arrive(arrive)
    request = request_of(x, y, z, replace=replace)
    as_json = options.json
    with context.connect(options) as client:
        flight = Flight(client, Position(request.x, request.y, request.z))
        reply = client.call(GOTO, request)
        if not as_json:
            output.line("accepted" if reply.accepted else "rejected")
        problem: QuadctlError | None = None
        if not reply.accepted:
            problem = Refused(reply.reason, refusal_hint(reply.reason))
        elif not no_wait:
            problem = _watch(client, flight, arrive, quiet=as_json)
    if as_json:
        output.document(report(flight, reply))
    elif flight.arrived:
        output.line(f"arrived within {flight.distance:.2f} m after {flight.seconds:.2f} s")
    if problem is not None:
        raise problem


def check_arrive(arrive: float | None) -> None:
    """Raise Invalid unless this is a time (s) to arrive in."""
    if arrive is not None and not 0 < arrive <= LONGEST_TIMEOUT:
        raise Invalid(f"--arrive {arrive}: not a time", "give seconds, more than 0")


def _watch(
    client: Client, flight: Flight, arrive: float | None, *, quiet: bool
) -> QuadctlError | None:
    """Show the flight until it ends; return the error that kept it from its goal."""
    try:
        flight.begin()
        whole = max(flight.distance, 1e-6)
        limit = arrive or (0 if flight.reason else patience(client, whole))
        with Progress("flying", quiet=quiet) as progress:

            def show(left: float) -> None:
                progress.update(1 - left / whole, flight.paused or f"{left:.2f} m to go")

            def show_pause(paused: str) -> None:
                if not quiet:
                    output.note(paused or "went on")

            flight.watch(limit, show, show_pause)
    except QuadctlError as problem:
        return problem
    except KeyboardInterrupt:
        output.note("stopped waiting: the flight goes on; `quadctl hold` stops it")
        raise
    return None


def report(flight: Flight | None, reply: GotoResponse) -> dict[str, Any]:
    """Return the --json document of a verdict and its flight, which is None without an answer."""
    known = flight is not None and math.isfinite(flight.distance)
    return {
        "accepted": reply.accepted,
        "reason": reply.reason or (flight.reason if flight else ""),
        "arrived": flight is not None and flight.arrived,
        "distance": flight.distance if flight and known else None,
        "seconds": flight.seconds if flight and known else None,
    }


def refusal_hint(reason: str) -> str:
    """Return the hint for a goal that safety has rejected."""
    if reason.startswith("busy"):
        return "`--replace` changes course; `quadctl hold` stops"
    return "`quadctl cage show` and `quadctl state` show more"


def request_of(x: float, y: float, z: float, *, replace: bool) -> GotoRequest:
    """Return a request for a point, m; raise Invalid for a bad coordinate."""
    point = {"x": x, "y": y, "z": z}
    try:
        return msgspec.convert(point | {"replace": replace}, GotoRequest)
    except msgspec.ValidationError as error:
        axis = str(error).rpartition("$.")[2].rstrip("`")
        raise Invalid(
            f"{axis} = {point[axis]:g} is not a valid coordinate",
            "coordinates are metres, finite, and at most 10 km from the origin",
        ) from error
