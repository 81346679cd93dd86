"""Supervisor: the loop over a ManagedProcess for each row of the process table."""

import signal
import time
from collections import deque
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any, TextIO

from quadctl.services.runtime import (
    entry,  # noqa: F401 - what every node begins with, loaded once for all that are forked
)
from quadctl.services.runtime.errors import AlreadyServed
from quadctl.services.runtime.process_table import (
    GRACE,
    QUICK,
    START_TIMEOUT,
    Process,
    RestartPolicy,
)
from quadctl.services.runtime.run_files import ProcessRecord
from quadctl.services.runtime.supervisor import control, descendants, fork
from quadctl.services.runtime.supervisor.child import MOST, Child, LogLine
from quadctl.services.runtime.supervisor.launch import Launch, RunDirectory
from quadctl.services.runtime.supervisor.logs import Emit, Logs, Printer
from quadctl.services.runtime.supervisor.probes import LivenessProbe


class ManagedProcess:
    """A process, its life, and the child that is running it now, if any; time (s) is passed in."""

    def __init__(self, process: Process, spawn: Callable[[Process, int], Child]) -> None:
        """`spawn` starts the process, after so many restarts."""
        self.process, self._spawn = process, spawn
        self.life = RestartPolicy(
            must_announce=process.must_announce, must_answer=not process.stranger
        )
        self.child: Child | None = None
        self._due: float | None = 0.0
        self._started = 0.0
        self._kill_at: float | None = None
        self._said: list[LogLine] = []
        self._held: deque[LogLine] = deque(maxlen=MOST)

    def record(self) -> ProcessRecord:
        """The row of the run record."""
        pid, started = (self.child.pid, self._started) if self.child else (0, 0.0)
        life = self.life
        return ProcessRecord(self.process.name, pid, life.state, life.restarts, started)

    def update(self, now: float, *, deaf: bool, answer_timeout: float) -> None:
        """Start it when that is due, see whether it has ended, end it when it must be.

        `deaf` says that it could not have been heard lately.
        """
        if self.child is None:
            if self._due is not None and now >= self._due:
                self._start(now)
            return
        if self.child.exit_code() is not None:
            self._reap(now)
            return
        if self._kill_at is not None:
            if now >= self._kill_at:
                self.child.kill()
            return
        self.life.runs(now)
        if deaf:
            self.life.reset_watchdog(now)
        elif why := self.life.timed_out(now, max(answer_timeout, self.process.patience)):
            self._log(f"{self.process.name}: {why}: killed")
            self.child.kill()
            self.child.wait(GRACE)
            self._reap(now)

    def restart(self, now: float, why: str) -> None:
        """End it, where it runs, and start it anew at once."""
        if self._kill_at is not None:
            return
        self._log(f"{self.process.name}: {why}")
        self.life.on_restart_request()
        self._due = now
        if self.child is not None:
            self.child.terminate()
            self._kill_at = now + self.process.grace

    def announced(self, now: float) -> None:
        """It was seen on the bus."""
        if self.child is not None and self._kill_at is None:
            self.life.ready(now)

    def answered(self, now: float) -> None:
        """It replied to a ping."""
        if self.child is not None:
            self.life.answered(now)

    def take_said(self) -> list[LogLine]:
        """What is to be shown of it. The tries while another has its name are not."""
        fresh = self.child.take_lines() if self.child else []
        if self.life.taken:
            self._held += fresh
        elif fresh or self._held:
            self._said += [*self._held, *fresh]
            self._held.clear()
        said, self._said = self._said, []
        return said

    def _start(self, now: float) -> None:
        self._due, self._started = None, time.time()
        self.life.started(now)
        self.child = self._spawn(self.process, self.life.restarts)

    def _reap(self, now: float) -> None:
        child, asked, was_taken = self.child, self._kill_at is not None, self.life.taken
        if child is None:
            return
        # What it has started goes with it, and lets go of its pipe.
        child.kill()
        how = child.last_words()
        self.child = self._kill_at = None
        delay = 0.0 if asked else self.life.on_exit(now, child.exit_code())
        self._due = None if delay is None else now + delay
        if was_taken and self.life.taken:
            self._held.clear()
            return
        self._said += [*self._held, *child.take_lines()]
        self._held.clear()
        if asked:
            return
        then = "left down" if delay is None else f"restarting in {delay:g} s"
        if self.life.taken:
            then = f"another process has its name; tried again every {delay:g} s"
        self._log(f"{self.process.name} ended ({how}): {then}")

    def _log(self, line: str) -> None:
        self._said.append(LogLine(time.time(), "up", line))


_PING_EVERY = 0.5
_LOOK_EVERY = 0.1
"""Seconds between looks where nothing happens; lines, and what comes or ends, wake the loop."""


class Supervisor:
    """Keeps the table of processes running. One loop; threads only post to its inbox."""

    def __init__(self, launch: Launch, home: RunDirectory, logs: Logs) -> None:
        self._launch, self._home, self._logs = launch, home, logs
        self._inbox: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._rows = {
            process.name: ManagedProcess(process, self._spawn) for process in launch.processes()
        }
        self._leash = descendants.new_mark()
        self._warden: fork.ForkedProcess | None = None
        self._health: LivenessProbe | None = None
        self._launched = time.monotonic()
        self._stopped_by = 0
        self._woken = False
        self._next_ping = self._looked = 0.0
        self._written: list[ProcessRecord] = []

    def rows(self) -> list[ProcessRecord]:
        """The processes as they are now."""
        return [row.record() for row in self._rows.values()]

    def run(self, on_settled: Callable[[str], None], on_look: Callable[[], None]) -> int:
        """Run until SIGINT, SIGTERM or SIGHUP; returns the signal's number.

        `on_settled` is called once: with an empty text when all are ready, or with the last
        lines of the first process that is left down. Raises AlreadyServed where the realm's folder
        was removed and another run has taken the realm. `on_look` is called at every look, ten times a second.
        """
        self._hear_signals()
        settled = False
        try:
            # First all processes, which are forked, and then the threads that forbid forking.
            if fork.possible() and any(row.process.stranger for row in self._rows.values()):
                self._warden = descendants.watch(self._leash)
            self._look(time.monotonic())
            self._listen()
            while not self._stopped_by:
                self._look(time.monotonic())
                if not settled and (verdict := self._verdict()) is not None:
                    settled = True
                    on_settled(verdict)
                on_look()
                self._serve_inbox(_LOOK_EVERY)
        finally:
            self._stop_all()
        return self._stopped_by

    def stop(self) -> None:
        """End the run as SIGTERM would."""
        self._stopped_by = signal.SIGTERM

    def _hear_signals(self) -> None:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            # Under nohup a closed terminal is not our end.
            if number and not (name == "SIGHUP" and signal.getsignal(number) == signal.SIG_IGN):
                signal.signal(number, self._on_signal)

    def _on_signal(self, number: int, _frame: Any) -> None:
        self._stopped_by = number
        self._inbox.put(self._wake)

    def _wake(self) -> None:
        """Look at the children at once."""
        self._woken = True

    def _listen(self) -> None:
        for row in self._rows.values():
            if row.child is not None:
                row.child.listen()
        self._health = LivenessProbe(
            self._home.address,
            self._launch.vehicles,
            self._inbox.put,
            self._on_ready,
            self._on_answer,
        )

    def _serve_inbox(self, timeout: float) -> None:
        deadline, self._woken = time.monotonic() + timeout, False
        try:
            while not self._woken and (left := deadline - time.monotonic()) > 0:
                self._inbox.get(timeout=left)()
        except Empty:
            pass

    def _verdict(self) -> str | None:
        since = time.monotonic() - self._launched
        for name, row in self._rows.items():
            last = self._logs.last(name)
            if row.life.state == "down":
                return f"{name} does not stay up; its last lines:\n{last}"
            if row.life.taken and since > QUICK:
                return f"{name} is another process already; its last lines:\n{last}"
            if since > START_TIMEOUT and row.life.state != "ready":
                return f"{name} is not ready after {START_TIMEOUT:g} s\n{last}"
        ready = all(row.life.state == "ready" for row in self._rows.values())
        return "" if ready else None

    def _look(self, now: float) -> None:
        for name in control.pending_restarts(self._home.realm):
            if name in self._rows:
                self._rows[name].restart(now, "restart asked for")
        # Asleep ourselves, or behind a hub that is not there, nobody could have been heard.
        asleep = now - self._looked > _PING_EVERY
        self._looked = now
        for row in self._rows.values():
            # Behind a frozen hub all are silent; it comes first in the table, and is killed.
            deaf = asleep or (row.process.name != "hub" and not self._hub_is_ready())
            row.update(now, deaf=deaf, answer_timeout=self._launch.params.supervise.answer_timeout)
        self._show()
        self._write_record()
        self._logs.look(now)
        if now >= self._next_ping:
            self._next_ping = now + _PING_EVERY
            self._ping()
            self._mend_home(now)

    def _mend_home(self, now: float) -> None:
        hub = self._rows.get("hub")
        try:
            made = self._home.repair(lambda line: self._logs.show("up", line))
        except AlreadyServed:
            # Asked to end, our hub would remove its socket, which is the other run's by now.
            if hub is not None and hub.child is not None:
                hub.child.kill()
            raise
        if made:
            self._logs.close()
            self._written = []
            if hub is not None:
                hub.restart(now, "its socket was removed: restarted")

    def _hub_is_ready(self) -> bool:
        return "hub" not in self._rows or self._rows["hub"].life.state == "ready"

    def _ping(self) -> None:
        timeout = self._launch.params.supervise.answer_timeout
        for name, row in self._rows.items():
            if self._health and row.life.state == "ready" and row.process.must_announce:
                self._health.ping(name, max(timeout, row.process.patience))

    def _spawn(self, process: Process, restarts: int) -> Child:
        child = Child(
            process,
            self._launch.environment(restarts),
            self._launch.folder,
            self._leash,
            lambda: self._inbox.put(self._show),
            lambda: self._inbox.put(self._wake),
        )
        if self._health is not None:
            child.listen()
        return child

    def _on_ready(self, name: str) -> None:
        if name in self._rows:
            self._rows[name].announced(time.monotonic())
            self._wake()

    def _on_answer(self, name: str) -> None:
        if name in self._rows:
            self._rows[name].answered(time.monotonic())

    def _show(self) -> None:
        said = [line for row in self._rows.values() for line in row.take_said()]
        for at, name, line in sorted(said, key=lambda said: said.at):
            self._logs.show(name, line, at)

    def _write_record(self) -> None:
        rows = self.rows()
        # Where the disk did not take it, the next look tries again.
        if rows != self._written and self._logs.disk.try_write(lambda: self._home.write(rows)):
            self._written = rows

    def _stop_all(self) -> None:
        # The hub last, so that the others can still say goodbye.
        for names in (self._rows.keys() - {"hub"}, self._rows.keys() & {"hub"}):
            rows = [self._rows[name] for name in names]
            children = [(child, row.process.grace) for row in rows if (child := row.child)]
            for child, _ in children:
                child.terminate()
            asked = time.monotonic()
            for child, grace in children:
                child.wait(asked + grace - time.monotonic())
                # What has ended by itself may have left something behind.
                child.kill()
                child.wait(GRACE)
                child.last_words()
        if self._health is not None:
            self._health.close()
        if self._warden is not None:
            self._warden.send_signal(signal.SIGKILL)
            self._warden.wait(GRACE)
        self._show()
        self._logs.close()


def run(
    launch: Launch,
    stream: TextIO | Emit,
    on_settled: Callable[[Supervisor, str], None],
    on_look: Callable[[Supervisor], None] | None = None,
) -> int:
    """Supervise until a signal; returns its number. Leaves nothing of the run behind.

    Lines go to a text stream, or to a function. `on_look` is called ten times a second.
    Raises AlreadyServed when the realm is live.
    """
    with RunDirectory(launch) as home:
        logs = Logs(home.realm.logs, stream if callable(stream) else Printer(stream))
        supervisor = Supervisor(launch, home, logs)
        return supervisor.run(
            lambda failed: on_settled(supervisor, failed),
            lambda: on_look(supervisor) if on_look else None,
        )
