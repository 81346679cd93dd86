"""Process of a campaign: an order on stdin, progress and report on stdout.

`quadctl campaign` starts it: the command itself imports neither safety nor dynamics. It ends when its
stdin is closed.
"""

import os
import sys
import threading
from importlib.util import find_spec

import msgspec

from quadctl.services.campaign.score import Flown, document, seeds
from quadctl.services.campaign.vehicles import Plain
from quadctl.services.campaign.workers import Job, Order, Worker, WorkerPool, batch, say
from quadctl.services.runtime.errors import QuadctlError

BATCH = 500
"""Flights that a worker flies at once: enough for its arrays, few enough to share out evenly."""
FEW = 8
"""The same in plain Python, where it makes no difference but to the progress that is seen."""
_PATIENCE = 5.0
"""A worker that is not ready after this (s) has something to compile."""


def main() -> None:
    """Carry out one order; exit 1 with an error document where it cannot be."""
    order = msgspec.json.decode(sys.stdin.buffer.readline(), type=Order)
    threading.Thread(target=_watch_stdin, daemon=True).start()
    try:
        _replay(order) if order.replay else _campaign(order)
    except QuadctlError as problem:
        say({"error": {"message": problem.message, "hint": problem.hint}})
    sys.stdout.flush()
    os._exit(0)


def _campaign(order: Order) -> None:
    every = seeds(order.seed, order.flights)
    is_fast = find_spec("numba") is not None
    if not is_fast:
        say({"note": "without numba (`pip install 'quadctl[fleet]'`) this takes far longer"})
    size = min(BATCH if is_fast else FEW, -(-order.flights // order.processes))
    jobs = [
        Job(first, min(size, every.stop - first), order.seconds, order.faults, order.wind)
        for first in every[::size]
    ]
    flown: list[Flown] = []

    def on_flown(more: list[Flown]) -> None:
        flown.extend(more)
        say({"flown": len(flown)})

    # The first one compiles the vehicle, where that must be; the others find it compiled.
    first = Worker()
    said = {"note": "compiling the vehicle, once for this machine"}
    note = threading.Timer(_PATIENCE, say, [said])
    note.start()
    first.fly(Job(0, 0, order.seconds, order.faults, order.wind))
    note.cancel()
    workers = [first, *(Worker() for _ in range(min(order.processes, len(jobs)) - 1))]
    WorkerPool(jobs, on_flown).fly(workers)
    say({"report": document(order.seed, flown)})


def _replay(order: Order) -> None:
    flight = batch(Job(order.seed, 1, order.seconds, order.faults, order.wind), Plain, log=True)
    flown = flight.fly()
    mission, diary = flight.missions[0], flight.lanes[0].diary
    said = {"start": mission.start, "safety": mission.safety, "log": diary.lines}
    say({"report": document(order.seed, flown) | said})


def _watch_stdin() -> None:
    sys.stdin.buffer.read()
    os._exit(0)


if __name__ == "__main__":
    main()
