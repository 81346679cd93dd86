"""Cost of several vehicles in one run, in hover and all of them in flight."""

import time
from collections import Counter
from itertools import cycle

import msgspec
import zenoh

from benchmarks import proc
from benchmarks.children import Failed
from benchmarks.effort import Effort
from benchmarks.raw.session import opened
from benchmarks.results import Results
from benchmarks.system import Home, running
from quadctl.services.dynamics.compiler import have_made

_HZ, _LEAST_HZ = 20, 19
_SETTLED = 5.0
_LEG_SECONDS = 2.5
_AWAY = ((1.0, 0.0, 1.0), (1.0, 1.0, 1.5), (0.0, 1.0, 1.0), (0.0, 0.0, 2.0))
"""Goals (m), relative to the start of a vehicle."""
_WIDE = ("--set", "safety.virtual_cage.x=100", "--set", "safety.virtual_cage.y=100")
"""Options for a larger cage: the grid of starts is larger than the default one."""
_COUNTS = (1, 10, 100)


def measure(results: Results, effort: Effort) -> None:
    """Measure the processor time of the whole run, and per vehicle.

    The vehicle's compiled code exists by then: it is made once per machine.
    """
    have_made()
    hovering = share = 0.0
    for count in _COUNTS:
        with running(*_words(count)) as where, opened(where.endpoint) as session:
            time.sleep(_SETTLED)
            hovering = _busy(where, effort.seconds)
            share = flying(where, session, count, effort.seconds)
        results.add(f"each_of_{count}", "ours", [share / count])
    results.add("hover_100", "ours", [hovering])
    results.add("vehicles_100", "ours", [share])
    for _ in range(effort.large_launches):
        began = time.perf_counter()
        with running(*_words(max(_COUNTS))):
            results.seconds("launch_100", "ours", [time.perf_counter() - began])


def _words(count: int) -> tuple[str, ...]:
    return "--vehicles", str(count), *_WIDE, "--set", f"dynamics.rate={_HZ}"


def _busy(where: Home, seconds: float) -> float:
    """Return the run's share of one core (%) for so long."""
    processes = where.processes()
    busy, began = proc.busy_of(processes), time.monotonic()
    time.sleep(seconds)
    passed, after = time.monotonic() - began, proc.busy_of(processes)
    return 100 * (sum(after.values()) - sum(busy.values())) / passed


def flying(where: Home, session: zenoh.Session, count: int, seconds: float) -> float:
    """Return the run's share of one core (%) for so long; raise Failed if poses are missing."""
    names = [f"uav{number}" for number in range(count)]
    homes: dict[str, tuple[float, float]] = {}
    heard: Counter[str] = Counter()

    def on_pose(sample: zenoh.Sample) -> None:
        name = str(sample.key_expr).partition("/")[0]
        heard[name] += 1
        if name not in homes:
            at = msgspec.msgpack.decode(sample.payload.to_bytes())["position"]
            homes[name] = at["x"], at["y"]

    poses = session.declare_subscriber(
        "*/pose/slow", zenoh.handlers.Callback(on_pose, indirect=False)
    )
    time.sleep(_SETTLED)
    processes, before = where.processes(), Counter(heard)
    busy, began = proc.busy_of(processes), time.monotonic()
    for x, y, z in cycle(_AWAY):
        for name in names:
            east, north = homes[name]
            _send(session, name, {"x": east + x, "y": north + y, "z": z, "replace": True})
        left = began + seconds - time.monotonic()
        time.sleep(max(min(left, _LEG_SECONDS), 0))
        if left <= _LEG_SECONDS:
            break
    passed, after = time.monotonic() - began, proc.busy_of(processes)
    poses.undeclare()
    slowest = min((heard[name] - before[name]) / passed for name in names)
    if slowest < _LEAST_HZ:
        raise Failed(f"of {count} vehicles one has poses at {slowest:.1f} Hz")
    return 100 * (sum(after.values()) - sum(busy.values())) / passed


def _send(session: zenoh.Session, name: str, goal: dict[str, float | bool]) -> None:
    for reply in session.get(f"{name}/@srv/goto", payload=msgspec.msgpack.encode(goal)):
        answer = reply.ok and msgspec.msgpack.decode(reply.ok.payload.to_bytes())
        if answer and answer["accepted"]:
            return
    raise Failed(f"{name} takes no goal")
