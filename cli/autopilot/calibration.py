"""`autopilot calibrate`: flights to and fro, and the parameters that they show."""

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple, replace

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.schemas.messages import Pose, Position
from quadctl.schemas.services import GotoRequest
from quadctl.schemas.topics import POSE
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import Invalid, Refused, TimedOut
from quadctl.vehicle import Flight, Vehicle, restless, slowed, speed

_LEAST, _MOST = 0.5, 100.0
"""Bounds of the flights' length, m."""
_ROOM = 1.5
"""Factor of a declared value over the measured one."""
_LEAST_MARGIN = 0.05
"""Least margin that is declared, m."""
_FAST, _HOVERS = 0.8, 0.3
"""Share of the top speed at which a flight is stopped, and speed (m/s) of a vehicle that hovers."""
_WINDOW = 0.2
"""Seconds over which an acceleration is measured: shorter ones are noise."""
_WAIT = 30.0
"""Seconds of one flight."""


Approach = tuple[float, float]
"""Speed (m/s) on the way to a goal, and the distance that is left, m."""


class Measured(Struct):
    """Flights of a calibration: m, s, m/s and Hz.

    `reaction` is from the command to stop until the speed falls, `stop` the distance from the command
    to the farthest place, `overshoot` how far a goal is passed, and `stray` how far a straight way is left.
    """

    rate: float = 0.0
    gap: float = 0.0
    speed: float = 0.0
    reaction: float = 0.0
    stop: float = 0.0
    overshoot: float = 0.0
    stray: float = 0.0
    approach: float = 0.0
    """Deceleration (m/s^2) that a flight to a goal needs to stop there, at most."""
    acceleration: float = 0.0
    """Most acceleration, m/s^2."""
    braking: float = math.inf
    """Least mean deceleration (m/s^2) of a stop, from its reaction to rest."""

    def widen(self, **values: float) -> None:
        """Keep the larger of each value and the one that was measured before."""
        for name, value in values.items():
            setattr(self, name, max(getattr(self, name), float(value)))

    def declared(self, approaches: Sequence[Approach]) -> dict[str, float]:
        """Return the parameters that declare it, with room.

        The margin is wide enough that none of the flights to a goal would have been stopped, had the
        goal been on a wall.
        """
        braking, reaction = _rounded(_ROOM * self.approach), _rounded(self.reaction)
        passed = max(v * reaction + v * v / (2 * braking) - left for v, left in approaches)
        return {
            "safety.max_speed": _rounded(_ROOM * self.speed),
            "safety.max_deceleration": braking,
            "safety.reaction": reaction,
            "safety.max_acceleration": _rounded(_ROOM * self.acceleration),
            "safety.min_deceleration": _rounded(self.braking / _ROOM),
            "safety.margin": _rounded(
                max(_ROOM * max(self.overshoot, self.stray, passed), _LEAST_MARGIN)
            ),
            "safety.pose_timeout": _rounded(max(2 * _ROOM * self.gap, 0.2)),
            "dynamics.control.max_speed": _rounded(self.speed),
        }

    @property
    def beyond(self) -> float:
        """Return how far (m) the vehicle may fly from where it was commanded to stop."""
        return _ROOM * self.stop


def calibrate(options: Options, distance: float) -> None:
    """Fly to and fro along each axis, and print what was measured and the parameters for it."""
    if not _LEAST <= distance <= _MOST:
        raise Invalid(f"--distance {distance:g}: not a distance", f"from {_LEAST:g} to {_MOST:g} m")
    with context.connect(options) as client:
        measured, approaches = _fly(client, distance, quiet=options.json)
    declared = measured.declared(approaches)
    if options.json:
        output.document({"measured": measured, "stops_within": measured.beyond, "params": declared})
        return
    for line in (
        f"poses          {measured.rate:.1f} Hz, longest gap {measured.gap:.3f} s",
        f"top speed      {measured.speed:.2f} m/s",
        f"reaction       {measured.reaction:.2f} s from a stop's command to the braking",
        f"stop           {measured.stop:.2f} m from the command to rest",
        f"acceleration   {measured.acceleration:.2f} m/s^2 at most; a stop brakes with {measured.braking:.2f} at least",
        f"overshoot      {measured.overshoot:.3f} m past a goal, {measured.stray:.3f} m off its way",
        f"stops within   {measured.beyond:.2f} m, with room",
        *(f"quadctl param set {name} {value:g}" for name, value in declared.items()),
    ):
        output.line(line)


def _fly(client: Client, distance: float, *, quiet: bool) -> tuple[Measured, list[Approach]]:
    vehicle, measured, approaches = Vehicle(client), Measured(), list[Approach]()
    home = _rest(client)
    for axis in "xyz":
        there = replace(home, **{axis: getattr(home, axis) + distance})
        for start, end in ((home, there), (there, home)):
            if not quiet:
                output.note(f"flying {distance:g} m along {axis}")
            approaches += _measure_flight(measured, start, end, _flown(client, end))
        if axis != "z":
            _measure_stop(measured, client, there)
            _rest(client)
            vehicle.goto(*astuple(home))
            _rest(client)
    return measured, approaches


def _rest(client: Client) -> Position:
    """Wait until the vehicle hovers; return its place. Outdoors none is ever quite still."""
    pose = slowed(client, _HOVERS, _WAIT, 1.0)
    if pose is None:
        raise restless(_WAIT)
    return pose.position


def _flown(client: Client, goal: Position) -> list[tuple[float, Pose]]:
    """Fly to a goal; return the poses until the vehicle rests, each with the time (s) of its arrival."""
    messages = client.listen(POSE.key(client.vehicle))
    try:
        _begun(client, goal).wait(_WAIT)
        _rest(client)
    finally:
        messages.close()
    track = []
    while (message := messages.next(0)) is not None:
        with suppress(Invalid):  # another program's
            track.append((message.at / 1e9, message.decoded(Pose)))
    return track


def _begun(client: Client, goal: Position) -> Flight:
    flight = Flight(client, GotoRequest(*astuple(goal)))
    if not flight.accepted:
        raise flight.refusal()
    return flight


def _measure_flight(
    m: Measured, start: Position, end: Position, track: Sequence[tuple[float, Pose]]
) -> list[Approach]:
    if len(track) < 2:
        raise Refused("no poses came during a flight")
    times, poses = zip(*track, strict=True)
    gaps, speeds = np.diff(times), np.array([*map(speed, poses)])
    way = np.subtract(astuple(end), astuple(start))
    length = np.linalg.norm(way)
    places = np.array([astuple(pose.position) for pose in poses]) - astuple(start)
    done = places @ way / length
    strays = np.linalg.norm(places - np.outer(done, way / length), axis=1)
    left = length - done
    m.rate = float(len(gaps) / max(gaps.sum(), 1e-9))
    m.widen(gap=gaps.max(), speed=speeds.max(), acceleration=max(_accelerations(poses)))
    m.widen(overshoot=-left.min(), stray=strays.max())
    ahead, room = left > 0, max(_ROOM * max(m.overshoot, m.stray), _LEAST_MARGIN)
    m.widen(approach=np.max(speeds[ahead] ** 2 / (2 * (left[ahead] + room)), initial=0.0))
    return [*zip(speeds.tolist(), left.tolist(), strict=True)]


def _measure_stop(m: Measured, client: Client, goal: Position) -> None:
    """Stop a flight near its top speed, and measure how."""
    poses = client.subscribe(POSE)
    try:
        _begun(client, goal)
        top = 0.0
        for before in _each(client, poses):
            top = max(top, speed(before))
            # This flight may have a lower top speed than an earlier one.
            if speed(before) > _FAST * m.speed or (top > _HOVERS and speed(before) < _FAST * top):
                break
        Vehicle(client).hold()
        fastest, farthest = before, 0.0
        for pose in _each(client, poses):
            farthest = max(farthest, math.dist(astuple(pose.position), astuple(before.position)))
            fastest = max(fastest, pose, key=speed)
            if speed(pose) < _HOVERS:
                break
        reaction = fastest.stamp - before.stamp
        m.widen(reaction=reaction, stop=farthest)
        ahead = max(farthest - reaction * speed(fastest), _LEAST_MARGIN)
        m.braking = min(m.braking, speed(fastest) ** 2 / (2 * ahead))
    finally:
        poses.close()


def _accelerations(poses: Sequence[Pose]) -> Iterator[float]:
    """Yield the mean accelerations (m/s^2) between poses that are far enough apart; at least 0."""
    yield 0.0
    first = 0
    for pose in poses:
        while pose.stamp - poses[first].stamp >= _WINDOW:
            before, first = poses[first], first + 1
            change = math.dist(astuple(pose.velocity), astuple(before.velocity))
            yield change / (pose.stamp - before.stamp)


def _each(client: Client, poses: Any) -> Iterator[Pose]:
    ends = time.monotonic() + _WAIT
    while time.monotonic() < ends:
        pose = poses.next(client.timeout)
        if pose is None:
            raise client.silent(POSE.key(client.vehicle), poses.problem)
        yield pose
    raise TimedOut(f"the flight does not end within {_WAIT:g} s", "is the pilot flying?")


def _rounded(value: float) -> float:
    return float(f"{value:.2g}")
