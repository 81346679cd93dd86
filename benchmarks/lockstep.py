"""Speed of simulated time in lock-step, with the real processes and every pose recorded.

The least that it can take is a round trip for each pose that safety answers, and the vehicle's steps.
"""

import json
import statistics
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.children import PYTHON, Failed, Worker, workers
from benchmarks.effort import Effort
from benchmarks.ours.node import pose
from benchmarks.results import Results
from benchmarks.system import Home, hub, running
from quadctl.schemas.messages import Position, Setpoint
from quadctl.schemas.params import DynamicsParams
from quadctl.schemas.topics import SETPOINT
from quadctl.services.dynamics import compiler
from quadctl.services.dynamics.vehicle import Vehicle
from quadctl.services.runtime.bus import codec

_MISSION = Path(__file__).parents[1] / "examples" / "mission.toml"
_HOVER = 'end = 60.0\nrows = [{ at = 3.0, do = "calibrate" }]\n'
"""Mission of a take-off and a vehicle at rest: the cost is that of the bus and its processes."""
_AT_FULL_SPEED = ("--set", "dynamics.speed=0")
_ROUNDS = 2
"""Flights of each kind for one of `effort`: one takes a second, and they differ by a third."""
_TRIPS, _WARM, _PLACES = 400, 50, 12
_LEG = 2.5
_SETPOINT = Setpoint("0123456789abcdef", 1000, Position(1.25, -2.5, 1.0625), brake=False)
_CONNECTED_WITHIN = 5.0


def measure(results: Results, effort: Effort) -> None:
    """Measure a simulated second, in hover and in the example mission, beside the least time.

    The vehicle's compiled code exists by then: it is made once per machine.
    """
    compiler.have_made()
    for number in range(_ROUNDS * effort.flights):
        # Without ours beside them: at full speed it never rests, on the same cores.
        trips = _trips()
        with running(*_AT_FULL_SPEED) as where:
            hover = where.folder / "hover.toml"
            hover.write_text(_HOVER, encoding="utf-8")
            for kind, mission in {"hover": hover, "mission": _MISSION}.items():
                speed = _speed(where, mission)
                results.add(f"{kind}_speed", "ours", [speed], run=number)
                results.add(f"{kind}_second", "ours", [1000 / speed], run=number)
                step = _compiled_step() if kind == "mission" else 0.0
                least = 1000 * (SETPOINT.hz * statistics.mean(trips) + 1000 * step)
                results.add(f"{kind}_second", "raw", [least], run=number)
    with running(*_AT_FULL_SPEED, compiled=False) as where:
        for number in range(_ROUNDS * effort.flights):
            results.add("plain_second", "ours", [1000 / _speed(where, _MISSION)], run=number)


def _trips() -> list[float]:
    """Return the times (s) of bare round trips between several pairs of processes.

    By their places on the cores a trip takes 80 us in one pair and 370 us in the next, so few pairs
    would make the ratio a matter of luck.
    """
    found = []
    for _ in range(_PLACES):
        with _pinger() as pinger:
            pinger.ask("trip", count=_WARM)
            found += pinger.ask("trip", count=_TRIPS)
    return found


def _speed(where: Home, mission: Path) -> float:
    flown = json.loads(where.quadctl("fly", str(mission), "--json"))
    return float(flown["simulated_seconds"] / flown["wall_seconds"])


@contextmanager
def _pinger() -> Iterator[Worker]:
    """Start a bare vehicle and a bare monitor that answers each of its messages."""
    with hub() as home:
        ends = {"pong": len(codec.encode(_SETPOINT)), "ping": len(codec.encode(pose(1000)))}
        commands = [
            ([*PYTHON, "benchmarks.raw.node", home.endpoint, role, str(size)], home.raw)
            for role, size in ends.items()
        ]
        with workers(*commands) as (_, pinger):
            deadline = time.monotonic() + _CONNECTED_WITHIN
            while not pinger.ask("connected"):
                if time.monotonic() > deadline:
                    raise Failed("the bare monitor does not subscribe")
            yield pinger


def _compiled_step() -> float:
    """Return the time (s) of a compiled step in flight, ten between two poses."""
    code = compiler.stored()
    if code is None:
        raise Failed("there is no compiled vehicle: is the extra `fleet` installed?")
    vehicle = Vehicle(DynamicsParams())
    vehicle.fly = compiler.load(code)
    vehicle.goto(0.0, 0.0, 1.0)
    vehicle.advance(5000)
    vehicle.goto(2.0, 2.0, 1.5)
    poses = round(_LEG * 100)
    began = time.perf_counter()
    for _ in range(poses):
        vehicle.advance(10)
    return (time.perf_counter() - began) / (10 * poses)
