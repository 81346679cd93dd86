"""The supervisor: starts the processes, echoes their lines, restarts the dead, stops them all."""

import os
import signal
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

from services.runtime import record
from services.runtime.child import Child
from services.runtime.health import Health
from services.runtime.launch import Launch
from services.runtime.logs import Logs
from services.runtime.processes import START_TIMEOUT
from services.runtime.realm import Realm
from services.runtime.row import Row
from services.runtime.session import Address

_PING_EVERY = 0.5
_LOOK_EVERY = 0.05
_MOST_AT_ONCE = 1_000
_GRACE = 0.3
"""Seconds that a process may take to end when asked, before it is killed."""


class Supervisor:
    """Keeps the table of processes running. One loop; threads only post to its inbox."""

    def __init__(self, launch: Launch, realm: Realm, address: Address, logs: Logs) -> None:
        self._launch, self._realm, self._logs = launch, realm, logs
        self._inbox: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._rows = {process.name: Row(process) for process in launch.processes()}
        self._address = address
        self._health: Health | None = None
        self._launched = time.monotonic()
        self._stopped_by = 0
        self._next_ping = self._looked = 0.0

    def run(self, on_settled: Callable[[str], None]) -> int:
        """Run until SIGINT or SIGTERM; returns the signal's number.

        `on_settled` is called once: with an empty text when all are ready, or with the last
        lines of the first process that is left down.
        """
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        settled = False
        try:
            # First all processes, which are forked, and then the threads that forbid forking.
            self._look(time.monotonic())
            self._listen()
            while not self._stopped_by:
                self._look(time.monotonic())
                if not settled and (verdict := self._verdict()) is not None:
                    settled = True
                    on_settled(verdict)
                self._serve_inbox(_LOOK_EVERY)
        finally:
            self._stop_all()
        return self._stopped_by

    def _listen(self) -> None:
        for row in self._rows.values():
            if row.child is not None:
                row.child.listen()
        self._health = Health(
            self._address, self._launch.vehicle, self._inbox.put, self._on_ready, self._on_answer
        )

    def stop(self) -> None:
        """End the run as SIGTERM would."""
        self._stopped_by = signal.SIGTERM

    def _serve_inbox(self, timeout: float) -> None:
        try:
            self._inbox.get(timeout=timeout)()
            # No more than waits now: a chatty process must not keep the others unwatched.
            for _ in range(min(self._inbox.qsize(), _MOST_AT_ONCE)):
                self._inbox.get_nowait()()
        except Empty:
            pass

    def _on_signal(self, number: int, _frame: Any) -> None:
        self._stopped_by = number
        self._inbox.put(_wake)

    def _verdict(self) -> str | None:
        for name, row in self._rows.items():
            if row.life.state == "down":
                return f"{name} does not stay up; its last lines:\n{self._logs.last(name)}"
            late = time.monotonic() - self._launched > START_TIMEOUT
            if late and row.life.state != "ready":
                return f"{name} is not ready after {START_TIMEOUT:g} s\n{self._logs.last(name)}"
        ready = all(row.life.state == "ready" for row in self._rows.values())
        return "" if ready else None

    def _look(self, now: float) -> None:
        # Asleep ourselves, or behind a hub that is not there, nobody could have been heard.
        deaf = now - self._looked > _PING_EVERY or not self._hub_is_ready()
        self._looked = now
        for row in self._rows.values():
            if row.child is None:
                if row.due is not None and now >= row.due:
                    self._start(row, now)
            elif row.child.exit_code() is not None:
                self._bury(row, now)
            elif deaf and row.process.name != "hub":
                row.life.excuse(now)
            elif why := row.life.complaint(now, self._launch.params.supervise.answer_timeout):
                self._end(row, now, why)
                # Behind a frozen hub all are silent; it comes first in the table.
                deaf = row.process.name == "hub"
        if now >= self._next_ping:
            self._next_ping = now + _PING_EVERY
            self._ping()

    def _hub_is_ready(self) -> bool:
        return "hub" not in self._rows or self._rows["hub"].life.state == "ready"

    def _ping(self) -> None:
        for name, row in self._rows.items():
            if self._health and row.life.state == "ready" and row.process.must_announce:
                self._health.ping(name, self._launch.params.supervise.answer_timeout)

    def _start(self, row: Row, now: float) -> None:
        name = row.process.name
        row.due = None
        row.life.started(now)
        row.child = Child(
            row.process,
            self._launch.environment(row.life.restarts),
            self._launch.folder,
            lambda line: self._inbox.put(lambda: self._logs.show(name, line)),
            lambda: self._inbox.put(_wake),
        )
        if self._health is not None:
            row.child.listen()
        if not row.process.must_announce:
            row.life.ready(now)
        self._write_record()

    def _end(self, row: Row, now: float, why: str) -> None:
        self._logs.show("up", f"{row.process.name}: {why}: killed")
        if row.child is not None:
            row.child.kill()
            row.child.wait(_GRACE)
            self._bury(row, now)

    def _bury(self, row: Row, now: float) -> None:
        how = row.child.last_words() if row.child else ""
        self._serve_inbox(0)
        row.child = None
        delay = row.life.died(now)
        row.due = None if delay is None else now + delay
        then = "left down" if delay is None else f"restarting in {delay:g} s"
        self._logs.show("up", f"{row.process.name} ended ({how}): {then}")
        self._write_record()

    def _on_ready(self, name: str) -> None:
        row = self._rows.get(name)
        if row is not None and row.child is not None:
            row.life.ready(time.monotonic())
            self._write_record()

    def _on_answer(self, name: str) -> None:
        row = self._rows.get(name)
        if row is not None and row.child is not None:
            row.life.answered(time.monotonic())

    def _write_record(self) -> None:
        rows = [row.record() for row in self._rows.values()]
        run = record.RunRecord(self._realm.name, os.getpid(), self._launch.vehicle, rows)
        record.write(self._realm, run)

    def _stop_all(self) -> None:
        # The hub last, so that the others can still say goodbye.
        for names in (self._rows.keys() - {"hub"}, self._rows.keys() & {"hub"}):
            children = [child for name in names if (child := self._rows[name].child)]
            for child in children:
                child.terminate()
            deadline = time.monotonic() + _GRACE
            for child in children:
                if not child.wait(deadline - time.monotonic()):
                    child.kill()
                    child.wait(_GRACE)
                child.last_words()
        if self._health is not None:
            self._health.close()
        self._serve_inbox(0)


def _wake() -> None:
    """Makes the loop look at its children at once."""
