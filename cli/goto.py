"""`goto`: asks safety for a goal and watches the flight there."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cli import bus, options, output
from cli.progress import Progress
from services.runtime.errors import Invalid, Refused, TimedOut

if TYPE_CHECKING:
    from schemas.geometry import Position
    from services.runtime.client import Client, Stream

_SLACK = 5.0
"""Seconds that a flight may take beyond twice the planned time."""


def goto(
    ctx: typer.Context,
    x: Annotated[float, typer.Argument(help="East, m.")],
    y: Annotated[float, typer.Argument(help="North, m.")],
    z: Annotated[float, typer.Argument(help="Up, m.")],
    no_wait: Annotated[
        bool, typer.Option("--no-wait", help="Return with safety's verdict.")
    ] = False,
    replace: Annotated[
        bool, typer.Option("--replace", help="Change course while flying to another goal.")
    ] = False,
    arrive: Annotated[
        float | None,
        typer.Option(help="Seconds to arrive in [default: twice the planned time and 5]."),
    ] = None,
) -> None:
    """Fly to a point, if safety permits, and wait for the arrival.

    Example: quadctl goto 1 -2 1.5
    """
    from schemas.geometry import Position  # noqa: PLC0415 - see cli.bus
    from schemas.topics import POSE, STATE  # noqa: PLC0415

    request = _request(x, y, z, replace)
    if arrive is not None and not 0 < arrive < math.inf:
        raise Invalid(f"--arrive {arrive}: not a time", "give seconds, more than 0")
    as_json = options.of(ctx).json
    with bus.connect(ctx) as client:
        stream = client.listen(STATE.key(client.vehicle), POSE.key(client.vehicle))
        pose = client.first(POSE) if not no_wait else None
        reason = _ask(client, request)
        report: dict[str, Any] = {"accepted": not reason, "reason": reason, "arrived": False}
        if reason or pose is None:
            _verdict(report, as_json=as_json)
            return
        if not as_json:
            output.line("accepted")
        start = pose.position
        limit = arrive or _planned(client, start, request) * 2 + _SLACK
        flight = _Flight(client, stream, Position(request.x, request.y, request.z), limit)
        flight.watch(start, quiet=as_json)
    report |= {
        "arrived": flight.arrived,
        "distance": flight.distance,
        "seconds": flight.seconds,
        "reason": flight.reason,
    }
    if as_json:
        output.document(report)
    elif flight.arrived:
        output.line(f"arrived within {flight.distance:.2f} m after {flight.seconds:.2f} s")
    flight.raise_unless_arrived()


class _Flight:
    """One flight, as the state and pose topics tell it."""

    def __init__(self, client: Client, stream: Stream, goal: Position, limit: float) -> None:
        self._client, self._stream, self._goal, self._limit = client, stream, goal, limit
        self.arrived, self.reason = False, ""
        self.distance, self.seconds = math.inf, 0.0
        self._began: float | None = None
        self._moving = False

    def watch(self, start: Position, *, quiet: bool) -> None:
        """Follow the flight until it ends in any way; raises TimedOut when all falls silent."""
        whole = max(_distance(start, self._goal), 1e-6)
        ends = time.monotonic() + self._limit
        with Progress("flying", quiet=quiet) as progress:
            while not (self.arrived or self.reason):
                left = ends - time.monotonic()
                if left <= 0:
                    return
                message = self._stream.next(min(left, self._client.timeout))
                if message is None and left > self._client.timeout:
                    raise self._client.silent(f"{self._client.vehicle}/safety/state")
                if message is not None:
                    self._read(message)
                    progress.update(1 - self.distance / whole, f"{self.distance:.2f} m to go")

    def raise_unless_arrived(self) -> None:
        """Turn a flight that did not end at its goal into the error that it is."""
        if self.reason:
            raise Refused(f"the flight was stopped: {self.reason}", "`quadctl state` shows more")
        if not self.arrived:
            raise TimedOut(
                f"not there after {self._limit:.1f} s: {self.distance:.2f} m to go",
                "the flight goes on; `quadctl hold` stops it, --arrive waits longer",
            )

    def _read(self, message: Any) -> None:
        from schemas.messages import Pose, SafetyState  # noqa: PLC0415 - see cli.bus
        from services.runtime import wire  # noqa: PLC0415

        if message.key.endswith("/pose"):
            pose = wire.decode(Pose, message.payload, message.encoding)
            if self._began is None:
                self._began = pose.stamp
            self.distance = _distance(pose.position, self._goal)
            self.seconds = pose.stamp - self._began
            return
        state = wire.decode(SafetyState, message.payload, message.encoding)
        if state.goal == self._goal:
            self._moving = self._moving or state.state == "MOVING"
            self.arrived = self._moving and state.state == "HOVERING"
        elif self._moving and state.state != "VERIFYING":
            self.reason = state.reason or "another goal was accepted in its place"


def _request(x: float, y: float, z: float, replace: bool) -> Any:
    import msgspec  # noqa: PLC0415 - see cli.bus

    from schemas.requests import GotoRequest  # noqa: PLC0415

    try:
        return msgspec.convert({"x": x, "y": y, "z": z, "replace": replace}, GotoRequest)
    except msgspec.ValidationError as error:
        raise Invalid(
            f"({x}, {y}, {z}) is no point to fly to: {error}",
            "coordinates are metres, finite, and at most 10 km",
        ) from error


def _ask(client: Client, request: Any) -> str:
    from schemas.topics import GOTO  # noqa: PLC0415 - see cli.bus

    reply = client.call(GOTO, request)
    return "" if reply.accepted else reply.reason


def _verdict(report: dict[str, Any], *, as_json: bool) -> None:
    if as_json:
        output.document(report | {"distance": None, "seconds": None})
    elif report["accepted"]:
        output.line("accepted")
    else:
        output.line("rejected")
    if not report["accepted"]:
        raise Refused(report["reason"], "`quadctl cage show` and `quadctl state` say more")


def _planned(client: Client, start: Position, goal: Any) -> float:
    """An upper bound of a flight's time (s) from rest to rest, by the setpoint's limits."""
    from schemas.requests import GetParamsRequest  # noqa: PLC0415 - see cli.bus
    from schemas.topics import get_params  # noqa: PLC0415

    values = client.call(get_params("dynamics"), GetParamsRequest(["dynamics.control"])).values
    speed, acceleration, jerk = (
        float(values[f"dynamics.control.max_{name}"]) for name in ("speed", "acceleration", "jerk")
    )
    return _distance(start, goal) / speed + speed / acceleration + acceleration / jerk


def _distance(a: Any, b: Any) -> float:
    return math.dist((a.x, a.y, a.z), (b.x, b.y, b.z))
