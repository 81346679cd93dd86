"""Process of a campaign: an order on stdin, progress and report on stdout.

`quadctl campaign` starts it, and imports neither safety nor dynamics. It exits with its stdin.
"""

import os
import sys
import threading
from importlib.util import find_spec

import msgspec
from msgspec.structs import replace

from quadctl.services.campaign.cluster import ClusterPool, connect
from quadctl.services.campaign.score import Flown, document, seeds
from quadctl.services.campaign.vehicles import Plain
from quadctl.services.campaign.workers import Job, Order, Worker, WorkerPool, batch, emit
from quadctl.services.runtime.errors import QuadctlError

BATCH = 500
"""Flights per job of a worker: enough for its arrays, few enough to share out evenly."""
FEW = 8
"""The same in plain Python, where it only affects the steps of the progress."""
PROBE = Job(0, 1, 30.0, faults=True, wind=3.0)
"""Flight by which a cluster's workers prove that they calculate as this machine does."""
_PATIENCE = 5.0
"""Time (s) after which a worker that is not ready must be compiling."""


def main() -> None:
    """Carry out one order; if that fails, write an error document."""
    order = msgspec.json.decode(sys.stdin.buffer.readline(), type=Order)
    threading.Thread(target=_watch_stdin, daemon=True).start()
    try:
        _replay(order) if order.replay else _campaign(order)
    except QuadctlError as problem:
        emit({"error": {"code": problem.code, "message": problem.message, "hint": problem.hint}})
    sys.stdout.flush()
    os._exit(0)


def _campaign(order: Order) -> None:
    every = seeds(order.seed, order.flights)
    is_fast = find_spec("numba") is not None
    if not is_fast:
        emit(
            {
                "note": "without numba (`pip install '.[fleet]'` in the checkout) this takes much longer"
            }
        )
    size = min(BATCH if is_fast else FEW, -(-order.flights // order.processes))
    jobs = [
        Job(first, min(size, every.stop - first), order.seconds, order.faults, order.wind)
        for first in every[::size]
    ]
    flown: list[Flown] = []

    def on_flown(more: list[Flown]) -> None:
        flown.extend(more)
        emit({"flown": len(flown)})

    if order.dask:
        with connect(order.dask, order.processes, insecure=order.insecure) as client:
            expected = _start_workers(1)[0].fly(PROBE)
            pool = ClusterPool(client, jobs, on_flown, lambda note: emit({"note": note}))
            pool.fly(PROBE, expected)
    else:
        WorkerPool(jobs, on_flown).fly(_start_workers(min(order.processes, len(jobs))))
    emit({"report": document(order.seed, flown)})


def _start_workers(count: int) -> list[Worker]:
    """Return workers; if the vehicle is not compiled on this machine, the first compiles it."""
    workers = [Worker() for _ in range(count)]
    compiling = {"note": "compiling the vehicle, once for this machine"}
    note = threading.Timer(_PATIENCE, emit, [compiling])
    note.start()
    workers[0].fly(replace(PROBE, count=0))
    note.cancel()
    return workers


def _replay(order: Order) -> None:
    flight = batch(Job(order.seed, 1, order.seconds, order.faults, order.wind), Plain, log=True)
    flown = flight.fly()
    mission, diary = flight.missions[0], flight.lanes[0].diary
    details = {"start": mission.start, "safety": mission.safety, "log": diary.lines}
    emit({"report": document(order.seed, flown) | details})


def _watch_stdin() -> None:
    sys.stdin.buffer.read()
    os._exit(0)


if __name__ == "__main__":
    main()
