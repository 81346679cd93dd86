"""Process of a campaign: an order on stdin, progress and report on stdout.

`quadctl campaign` starts it, and imports neither safety nor dynamics. It exits with its stdin.
"""

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, nullcontext
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from quadctl.schemas.typed import from_json
from quadctl.services.campaign.database import Database
from quadctl.services.campaign.mission import Conditions, Mission
from quadctl.services.campaign.score import Flown, Tally, seeds
from quadctl.services.campaign.vehicles import Plain
from quadctl.services.campaign.workers import Job, Worker, WorkerPool, batch, emit
from quadctl.services.runtime.errors import QuadctlError

if TYPE_CHECKING:
    from distributed import Client

BATCH = 500
"""Flights per job of a worker: enough for its arrays, few enough to share out evenly."""
FEW = 8
"""The same in plain Python, where it only affects the steps of the progress."""
PROBE = Job(0, 1, Conditions(5.0, faults=True, wind=3.0))
"""Flight with a hash that differs between versions of the automaton and the dynamics."""
_PATIENCE = 5.0
"""Time (s) after which a worker that is not ready must be compiling."""


class Order(Struct, frozen=True):
    """Campaign to fly, or with `replay` only the flight of that seed, with its log.

    `dask` is the address of a scheduler, `local`, or empty; `insecure` allows an open one.
    With `search` a search of so many s for the worst flight, in at most `flights`; 0 is no limit.
    """

    flights: int
    seed: int
    processes: int
    conditions: Conditions
    db: str = ""
    report: str = ""
    command: str = ""
    """Command line of this order, for the report; with `--replay SEED` it is one for a flight."""
    dask: str = ""
    insecure: bool = False
    replay: bool = False
    search: float = 0.0


def main() -> None:
    """Carry out one order; if that fails, write an error document."""
    order = from_json(sys.stdin.buffer.readline(), Order)
    threading.Thread(target=_watch_stdin, daemon=True).start()
    try:
        (_replay if order.replay else _search if order.search else _campaign)(order)
    except QuadctlError as problem:
        emit({"error": (problem.exit_code, problem.message, problem.hint)})
    sys.stdout.flush()
    os._exit(0)


def _campaign(order: Order) -> None:
    if not order.dask:
        return _fly(order, None)
    from quadctl.services.campaign.cluster import connect

    # Before any work: a wrong address is refused at once.
    with connect(order.dask, order.processes, insecure=order.insecure) as client:
        return _fly(order, client)


def _fly(order: Order, client: "Client | None") -> None:
    every = seeds(order.seed, order.flights)
    size = min(
        (BATCH if _is_fast() else FEW) // order.conditions.vehicles or 1,
        -(-order.flights // order.processes),
    )
    count = 1 if client else min(order.processes, -(-order.flights // size))
    workers, probe = _started(count)
    # Without a name the database is a temporary file.
    kept = order.db or order.report
    opened = closing(Database(order.db, order.conditions, probe.hash)) if kept else nullcontext()
    with opened as database:
        missing = (
            database.missing(every, size)
            if database
            else (every[first : first + size] for first in range(0, len(every), size))
        )
        jobs = [Job(part.start, len(part), order.conditions) for part in missing]
        tally, worst = Tally(every), 0.0
        flown = order.flights - sum(job.count for job in jobs)
        emit({"ready": flown})

        def on_flown(more: list[Flown]) -> None:
            nonlocal flown, worst
            flown += len(more)
            worst = max(worst, *(flight.worst_excursion for flight in more))
            if database:
                database.add(more)
            else:
                for flight in more:
                    tally.add(flight)
            emit({"flown": flown, "worst": worst})

        if client and jobs:
            from quadctl.services.campaign.cluster import ClusterPool

            pool = ClusterPool(client, jobs, on_flown, lambda note: emit({"note": note}))
            pool.fly(PROBE, [probe])
        else:
            WorkerPool(jobs, on_flown).fly(workers)
        for flight in database.flights(every) if database else ():
            tally.add(flight)
        figures = tally.document(order.seed)
        if database and order.report:
            _write_report(order, database, figures)
        emit({"report": figures})


def _write_report(order: Order, database: Database, figures: dict[str, Any]) -> None:
    from quadctl.services.campaign import report  # matplotlib takes half a second
    from quadctl.services.campaign.track import retrace

    report.write(
        Path(order.report),
        database.connection,
        figures,
        f"{order.command} --flights {order.flights} --seed {order.seed}",
        lambda seed: f"{order.command} --replay {seed}",
        lambda seed: retrace(batch(Job(seed, 1, order.conditions), Plain)),
    )


def _is_fast() -> bool:
    return find_spec("numba") is not None


def _started(count: int) -> tuple[list[Worker], Flown]:
    """Start workers; return them, and the probe's flight, when the first is ready."""
    if not _is_fast():
        emit({"note": "without numba (`pip install 'quadctl[fleet]'`) this takes much longer"})
    workers = [Worker() for _ in range(count)]
    # A worker that compiles and one that waits for a busy machine look alike from here.
    preparing = {"note": "still starting: the first campaign of a machine compiles the vehicle"}
    note = threading.Timer(_PATIENCE, emit, [preparing])
    note.start()
    (probe,) = workers[0].fly(PROBE)
    note.cancel()
    return workers, probe


def _search(order: Order) -> None:
    try:
        from quadctl.services.campaign.search import POPULATION, RUNS, Search
    except ImportError as error:
        raise QuadctlError(
            f"the search is not installed: {error}",
            "`pip install 'quadctl[fleet]'`, into the same environment",
        ) from error
    workers, _ = _started(order.processes)
    # Whole runs, which share constants; two jobs for each worker, so that none waits for long.
    size = POPULATION * max(1, RUNS // (2 * order.processes)) if _is_fast() else FEW
    search, end = Search(order.seed, order.conditions), time.monotonic() + order.search
    left = order.flights or sys.maxsize
    emit({"ready": 0})

    def jobs(missions: list[Mission]) -> Iterator[Job]:
        for first in range(0, len(missions), size):
            if time.monotonic() >= end:
                return
            part = missions[first : first + size]
            yield Job(first, len(part), order.conditions, part)

    while left and time.monotonic() < end:
        flights: list[Flown] = []
        WorkerPool(jobs(search.ask()[:left]), flights.extend).fly(workers)
        left -= len(flights)
        if search.tell(flights):
            emit({"found": search.document()})
        emit({"flown": search.evaluations})
    emit({"report": search.document()})


def _replay(order: Order) -> None:
    flight = batch(Job(order.seed, 1, order.conditions), Plain, log=True)
    tally = Tally(range(order.seed, order.seed + 1))
    tally.add(*flight.fly())
    mission, logs = flight.missions[0], [lane.diary.lines for lane in flight.lanes]
    if len(logs) > 1:
        named = [[f"{line}  (uav{n})" for line in lines] for n, lines in enumerate(logs)]
        logs = [sorted(chain(*named), key=lambda line: float(line.split()[0]))]
    start = mission.dynamics.start
    details = {"start": (start.x, start.y, start.z), "safety": mission.safety, "log": logs[0]}
    emit({"report": tally.document(order.seed) | details})


def _watch_stdin() -> None:
    # Not by sys.stdin: its lock would turn any error of this process into a fatal one.
    while os.read(sys.stdin.fileno(), 4096):
        pass
    os._exit(0)


if __name__ == "__main__":
    main()
