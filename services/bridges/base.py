"""Common part of all bridges to other networks: their process, their vehicles, their clients' requests.

A bridge holds no safety logic: a goal, a call or a parameter goes the way of our own services, and is
refused by them.
"""

import argparse
import logging
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, Literal, NamedTuple, NoReturn, Protocol, TypeVar

import msgspec
from msgspec import Struct

from quadctl.schemas.messages import SafetyState
from quadctl.schemas.params import Params
from quadctl.schemas.services import (
    CalibrateRequest,
    GotoRequest,
    HoldRequest,
    ResetRequest,
    ToggleCageRequest,
)
from quadctl.schemas.topics import (
    CALIBRATE,
    GOTO,
    HOLD,
    RESET,
    SETPOINT,
    TOGGLE_CAGE,
    Service,
)
from quadctl.schemas.typed import from_json
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.errors import Refused, UsageError
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params.remote import RemoteParams

O = TypeVar("O", bound=Struct)  # noqa: E741 - options
Log = logging.Logger | logging.LoggerAdapter[logging.Logger]

TIMEOUT = 3.0
"""Seconds that a call to one of our services may take."""
AGE = 1.0
"""Seconds for which parameters need not be read again, unless they are set."""
PERIOD = 1 / SETPOINT.hz
"""Seconds between two goals of a client: safety decides at this rate, and calls go between."""
MOST_WAITING = 64
"""Requests of a client that may wait; beyond, they are refused."""


class Bridge(Protocol):
    """Vehicles on another network, served by one process."""

    def open(self, node: Node) -> None:
        """Open what the vehicles share; raise QuadctlError for wrong options or a taken port."""

    def add(self, node: Node, params: Params) -> None:
        """Add the vehicle of a node."""


def run_bridge(name: str, type_: type[O], make: Callable[[O], Bridge]) -> NoReturn:
    """Run the process of a bridge, in a run the node `name`; its options are JSON after `--options`."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--options", default="{}")
    given, sys.argv[1:] = parser.parse_known_args()
    bridges: list[Bridge] = []

    def run(node: Node, params: Params) -> None:
        if node.is_first:
            try:
                options = from_json(given.options, type_)
            except msgspec.DecodeError as error:
                raise UsageError(f"--options: {error}", "`quadctl bridge` makes them") from error
            bridges.append(make(options))
            bridges[0].open(node)
        bridges[0].add(node, params)
        node.spin()

    start(name, run, keeps_time=True)


class BridgedVehicle:
    """Vehicle behind a bridge: its services and its parameters; all methods but `see` block."""

    def __init__(self, node: Node) -> None:
        self.node, self.name = node, node.vehicle
        self.parameters = RemoteParams(self.call, node.endpoints)
        self.height: float | None = None
        """Height (m) of the present goal, once it is known."""

    def see(self, state: SafetyState) -> None:
        """Take the newest state."""
        self.height = state.goal.z

    def call(self, service: Service[Any, Any], request: Struct) -> Any:
        """Call a service of the vehicle."""
        return self.node.client(service).call(request, TIMEOUT)

    def fly(self, goal: GotoRequest) -> None:
        """Request a goal from safety; raise Refused with its reason."""
        reply = self.call(GOTO, goal)
        if not reply.accepted:
            raise Refused(reply.reason)

    def hold(self) -> None:
        """Stop the vehicle."""
        self.call(HOLD, HoldRequest())

    def reset(self) -> None:
        """Put the vehicle back at its start."""
        self.call(RESET, ResetRequest())

    def toggle_cage(self, *, on: bool) -> None:
        """Turn the cage on or off."""
        self.call(TOGGLE_CAGE, ToggleCageRequest(on))

    def calibrate(self) -> float:
        """Zero the barometer; return its baseline, hPa."""
        baseline: float = self.call(CALIBRATE, CalibrateRequest(zero=True)).baseline
        return baseline


class Complaints:
    """Log of faults that may repeat: a foreign publisher must not fill it."""

    def __init__(self, warn: Callable[[str, str], None]) -> None:
        self._warn, self._last = warn, ""

    def show(self, problem: str) -> None:
        """Log a problem unless it is the last one; an empty text means that it is over."""
        if problem and problem != self._last:
            self._warn("%s", problem)
        self._last = problem


Taken = Literal["added", "waits", "full"]
Job = Callable[[], None]


class RequestQueue:
    """Requests of one client: orders in their order, and reads, which do not hold orders up.

    A read comes after the orders that were sent before it. Each kind has a thread, from its first
    request on. `fail` takes what a job raises, on that thread.
    """

    def __init__(self, fail: Callable[[Exception], None]) -> None:
        self._fail, self._change = fail, threading.Condition()
        self._orders, self._reads = _Line(), _Line()
        self._ordered = self._executed = 0
        self._ended = False

    def order(self, job: Job, key: Any = None, *, newest: Any = None, once: bool = False) -> Taken:
        """Add an order, unless the last pending one has its key, or too many wait.

        A stop after another order is no repetition of a stop before it; with `once` any pending order
        with its key counts, as this one may be sent again. An order with the name of a goal, `newest`,
        takes the place of the one before if that has this name and still waits, and others wait as long as
        safety needs to decide on it: a flood must not queue up.
        """
        with self._change:
            jobs = self._orders.jobs
            if self._orders.has(key) if once else self._orders.ends_with(key):
                return "waits"
            if newest is not None:
                job = partial(_paced, job)
                if jobs and jobs[-1].newest == newest:
                    jobs[-1] = _Waiting(key, newest, job)
                    return "waits"
            taken = self._add(self._orders, _Waiting(key, newest, job))
            self._ordered += taken == "added"
            return taken

    def read(self, job: Job, key: Any = None) -> Taken:
        """Add a read, unless one with its key is pending already, or too many wait."""
        with self._change:
            if self._reads.has(key):
                return "waits"
            after = partial(self._after, self._ordered, job)
            return self._add(self._reads, _Waiting(key, None, after))

    def end(self) -> None:
        """Drop what waits, and end the threads."""
        with self._change:
            self._ended = True
            self._change.notify_all()

    def _add(self, line: "_Line", waiting: "_Waiting") -> Taken:
        if len(line.jobs) >= MOST_WAITING:
            return "full"
        line.jobs.append(waiting)
        if not line.works:
            line.works = True
            threading.Thread(target=self._work, args=(line,), daemon=True).start()
        self._change.notify_all()
        return "added"

    def _after(self, ordered: int, job: Job) -> None:
        with self._change:
            self._change.wait_for(lambda: self._executed >= ordered or self._ended)
        job()

    def _work(self, line: "_Line") -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: line.jobs or self._ended)
                if self._ended:
                    return
                line.present, _, job = line.jobs.popleft()
            try:
                job()
            except Exception as problem:  # noqa: BLE001 - a fault must not end all later requests
                self._fail(problem)
            with self._change:
                line.present = None
                self._executed += line is self._orders
                self._change.notify_all()


class _Waiting(NamedTuple):
    """Job that waits, its key, and the name of its goal."""

    key: Any
    newest: Any
    job: Job


class _Line:
    """Jobs that wait, and the key of the present one."""

    def __init__(self) -> None:
        self.jobs: deque[_Waiting] = deque()
        self.present: Any = None
        self.works = False

    def ends_with(self, key: Any) -> bool:
        """Return whether the last pending job has a key; those without one are not compared."""
        return key is not None and key == (self.jobs[-1].key if self.jobs else self.present)

    def has(self, key: Any) -> bool:
        """Return whether a job with a key is pending; those without one are not compared."""
        return key is not None and key in {self.present, *(each.key for each in self.jobs)}


def _paced(job: Job) -> None:
    """Execute a goal's order for as long as safety needs to decide on it."""
    began = time.monotonic()
    try:
        job()
    finally:
        time.sleep(max(began + PERIOD - time.monotonic(), 0))
