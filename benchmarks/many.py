"""Cost of several vehicles in one run, in hover and all of them in flight."""

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import cycle
from random import Random

import msgspec
import numpy as np
import zenoh

from benchmarks import proc
from benchmarks.children import Failed
from benchmarks.effort import Effort
from benchmarks.raw.session import opened
from benchmarks.results import Results
from benchmarks.system import Home, running
from quadctl.cli.fleet.plan import Space, plan
from quadctl.schemas.params import SeparationParams
from quadctl.services.dynamics.compiler import have_made

_HZ, _LEAST_HZ = 20, 19
_SETTLED = 5.0
_RESTED = 12.0
"""Seconds after a launch until the vehicles rest at their places."""
_LEG_SECONDS = 2.5
_AWAY = ((1.0, 0.0, 1.0), (1.0, 1.0, 1.5), (0.0, 1.0, 1.0), (0.0, 0.0, 2.0))
"""Goals (m), relative to the start of a vehicle."""
_WIDE = ("--set", "safety.virtual_cage.x=200", "--set", "safety.virtual_cage.y=200")
"""Options for a larger cage: the grid of starts is larger than the default one."""
_COUNTS = (1, 10, 100, 300)
_MANY, _MOVING = 1000, 4
"""Vehicles of the largest run, and which of them move: one in so many."""
_ALL, _FEW, _FEWER = "*/pose/slow", "uav$*0/pose/slow", "uav$*00/pose/slow"
"""Poses that are counted: in the largest run, to count those of all would take a core of its own."""
SHOWN = "uav500"
"""One of those that move, in the middle."""
_BUNDLES = "uav0/@all/pose/slow"
"""Key on which the run's processes send each other the poses of all."""


def measure(results: Results, effort: Effort) -> None:
    """Measure the processor time of the whole run, and per vehicle.

    The vehicle's compiled code exists by then: it is made once per machine.
    """
    have_made()
    for count in _COUNTS:
        with running(*_words(count)) as where, opened(where.endpoint) as session:
            time.sleep(_RESTED)
            hovering = _busy(where, effort.seconds)
            share, _ = flying(where, session, _names(count), effort.seconds, _FEW)
            if count == 100:
                watched, _ = flying(where, session, _names(count), effort.seconds, _ALL)
                results.add("watched_100", "ours", [watched])
        results.add(f"each_of_{count}", "ours", [share / count])
        if count >= 100:
            results.add(f"hover_{count}", "ours", [hovering])
            results.add(f"vehicles_{count}", "ours", [share])
    for _ in range(effort.large_launches):
        began = time.perf_counter()
        with running(*_words(100)):
            results.seconds("launch_100", "ours", [time.perf_counter() - began])
    _measure_most(results, effort)
    _measure_plan(results)


@contextmanager
def most() -> Iterator[tuple[Home, zenoh.Session]]:
    """Start a run of a thousand vehicles in the air, and a session with it."""
    words = *_words(_MANY), "--set", "dynamics.start.z=1"
    with running(*words) as where, opened(where.endpoint) as session:
        yield where, session


def fly_part(where: Home, session: zenoh.Session, seconds: float) -> tuple[float, list[float]]:
    """Fly a quarter of a thousand vehicles, as `flying` does."""
    return flying(where, session, _names(_MANY)[::_MOVING], seconds, _FEWER)


def _measure_most(results: Results, effort: Effort) -> None:
    """Measure a run of a thousand vehicles in the air, a quarter of which move."""
    bundles = list[bytes]()
    callback: zenoh.handlers.Callback[zenoh.Sample] = zenoh.handlers.Callback(
        lambda sample: bundles.append(sample.payload.to_bytes()), indirect=False
    )
    began = time.perf_counter()
    with most() as (where, session):
        results.seconds(f"launch_{_MANY}", "ours", [time.perf_counter() - began])
        time.sleep(_SETTLED)
        results.add(f"hover_{_MANY}", "ours", [_busy(where, effort.seconds)])
        poses = session.declare_subscriber(_BUNDLES, callback)
        share, calls = fly_part(where, session, effort.seconds)
        poses.undeclare()
        results.add(f"vehicles_{_MANY}", "ours", [share])
        results.seconds(f"goto_{_MANY}", "ours", [sorted(calls)[len(calls) * 99 // 100]])
        results.add(f"memory_{_MANY}", "ours", [sum(map(proc.pss, where.pids()))])
    results.add(f"separation_{_MANY}", "ours", [_least_apart(bundles)])


def _least_apart(bundles: Sequence[bytes]) -> float:
    """Return the least distance of two vehicles, in parts of the one that they keep; 0 without poses of all."""
    keep, places, least = SeparationParams(), dict[str, tuple[float, float, float]](), np.inf
    scale = np.array([2 * keep.radius, 2 * keep.radius, keep.height])
    for bundle in bundles:
        _, _, parts = msgspec.msgpack.decode(bundle)
        poses = {name: pose for name, pose, _ in parts}
        places |= {name: (*pose["position"].values(),) for name, pose in poses.items()}
        if len(places) == _MANY and "uav0" in poses:  # once a period
            at = np.array([*places.values()]) / scale
            apart = np.linalg.norm(at[:, None] - at[None], axis=2)
            np.fill_diagonal(apart, np.inf)
            least = min(least, float(apart.min()))
    return float(least) if least < np.inf else 0.0


def _measure_plan(results: Results) -> None:
    """Measure the plan in which 300 vehicles change places at random."""
    names = _names(300)
    places = {name: (2.0 * (n % 20), 2.0 * (n // 20), 1.0) for n, name in enumerate(names)}
    goals = dict(zip(names, Random(0).sample([*places.values()], len(names)), strict=True))
    space = Space(0.6, 0.9, (-100, -100, 0), (100, 100, 20), lambda *_: True)
    began = time.perf_counter()
    plan(places, goals, space)
    results.seconds("plan_300", "ours", [time.perf_counter() - began])


def _names(count: int) -> list[str]:
    return [f"uav{number}" for number in range(count)]


def _words(count: int) -> tuple[str, ...]:
    return "--vehicles", str(count), *_WIDE, "--set", f"dynamics.rate={_HZ}"


def _busy(where: Home, seconds: float) -> float:
    """Return the run's share of one core (%) for so long."""
    processes = where.processes()
    busy, began = proc.busy_of(processes), time.monotonic()
    time.sleep(seconds)
    passed, after = time.monotonic() - began, proc.busy_of(processes)
    return 100 * (sum(after.values()) - sum(busy.values())) / passed


def flying(
    where: Home,
    session: zenoh.Session,
    moving: Sequence[str],
    seconds: float,
    watched: str,
) -> tuple[float, list[float]]:
    """Return the run's share of one core (%) for so long, and how long (s) each goto took.

    Raises Failed if poses of a vehicle that is `watched` are missing.
    """
    homes = _homes(session, moving)
    heard: Counter[str] = Counter()

    def on_pose(sample: zenoh.Sample) -> None:
        heard[str(sample.key_expr)] += 1

    poses = session.declare_subscriber(watched, zenoh.handlers.Callback(on_pose, indirect=False))
    time.sleep(_SETTLED)
    processes, before = where.processes(), Counter(heard)
    calls: list[float] = []
    busy, began = proc.busy_of(processes), time.monotonic()
    for x, y, z in cycle(_AWAY):
        leg = time.monotonic()
        for name in moving:
            east, north = homes[name]
            called = time.perf_counter()
            _send(session, name, {"x": east + x, "y": north + y, "z": z, "replace": True})
            calls.append(time.perf_counter() - called)
        now = time.monotonic()
        time.sleep(max(min(began + seconds, leg + _LEG_SECONDS) - now, 0))
        if time.monotonic() >= began + seconds:
            break
    passed, after = time.monotonic() - began, proc.busy_of(processes)
    poses.undeclare()
    slowest = min((heard[key] - before[key]) / passed for key in heard)
    if slowest < _LEAST_HZ:
        raise Failed(f"one of {len(heard)} vehicles has poses at {slowest:.1f} Hz")
    return 100 * (sum(after.values()) - sum(busy.values())) / passed, calls


def _homes(session: zenoh.Session, names: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return where (m) each vehicle is, seen from above."""
    homes: dict[str, tuple[float, float]] = {}

    def on_pose(sample: zenoh.Sample) -> None:
        at = msgspec.msgpack.decode(sample.payload.to_bytes())["position"]
        homes[str(sample.key_expr).partition("/")[0]] = at["x"], at["y"]

    callback = zenoh.handlers.Callback(on_pose, indirect=False)
    poses, deadline = session.declare_subscriber("*/pose/slow", callback), time.monotonic() + 20
    while not homes.keys() >= set(names):
        if time.monotonic() > deadline:
            raise Failed(f"{len(set(names) - homes.keys())} vehicles have no pose")
        time.sleep(0.05)
    poses.undeclare()
    return homes


def _send(session: zenoh.Session, name: str, goal: dict[str, float | bool]) -> None:
    for reply in session.get(f"{name}/@srv/goto", payload=msgspec.msgpack.encode(goal)):
        answer = reply.ok and msgspec.msgpack.decode(reply.ok.payload.to_bytes())
        if answer and answer["accepted"]:
            return
    raise Failed(f"{name} takes no goal")
