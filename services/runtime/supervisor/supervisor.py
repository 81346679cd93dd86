"""Supervisor: the loop over a ManagedProcess for each row of the process table."""

import errno
import signal
import subprocess
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from queue import Empty, SimpleQueue
from typing import Any

from quadctl.services.runtime import (
    entry,  # noqa: F401 - every node imports it: loaded once here for all that are forked
)
from quadctl.services.runtime.errors import AlreadyServed
from quadctl.services.runtime.process_table import (
    GRACE,
    NOT_READY,
    PING_EVERY,
    QUICK,
    START_TIMEOUT,
    Process,
    RestartPolicy,
    cut_off,
)
from quadctl.services.runtime.procfs import WaitMeter
from quadctl.services.runtime.run_files import ProcessRecord
from quadctl.services.runtime.shutdown import uninterrupted
from quadctl.services.runtime.supervisor import control, descendants, fork
from quadctl.services.runtime.supervisor.child import MOST, Child, LogLine
from quadctl.services.runtime.supervisor.launch import Launch, RunDirectory
from quadctl.services.runtime.supervisor.logs import Emit, Logs
from quadctl.services.runtime.supervisor.probes import LivenessProbe


class ManagedProcess:
    """A process and its restart policy; `spawn` gets the number of restarts; times are in s."""

    def __init__(self, process: Process, spawn: Callable[[Process, int], Child]) -> None:
        self.process, self._spawn = process, spawn
        self.life = RestartPolicy(
            must_announce=process.must_announce, must_answer=not process.stranger
        )
        self.child: Child | None = None
        self._due: float | None = 0.0
        self._started = self._began = 0.0
        self._kill_at: float | None = None
        self._waits = WaitMeter()
        self._lines: list[LogLine] = []
        self._held: deque[LogLine] = deque(maxlen=MOST)

    def record(self) -> ProcessRecord:
        """Return the process's row of the run's state."""
        life, name = self.life, self.process.name
        if self.child is None:
            return ProcessRecord(name, 0, life.state, life.restarts)
        started, began = self._started, self._began
        return ProcessRecord(name, self.child.pid, life.state, life.restarts, started, began)

    def update(self, now: float, *, offline: bool, timeout: float) -> None:
        """Start it when due, reap it if it has ended, kill it if it has timed out.

        `offline` means that no answer of it could have arrived lately.
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
        if offline:
            self.life.reset_watchdog(now)
        elif why := self.life.timed_out(now, max(timeout, self.process.patience)):
            self._log(f"{self.process.name}: {why}: killed")
            self.child.kill()
            self.child.wait(GRACE)
            self._reap(now)

    def waited(self) -> float:
        """Return for how many seconds since the last call it has waited for a processor."""
        return self._waits.read(self.child.pid) if self.child else 0.0

    def restart(self, now: float, why: str) -> None:
        """End it if it runs, and start it again at once."""
        if self._kill_at is not None:
            return
        self._log(f"{self.process.name}: {why}")
        self.life.on_restart_request()
        self._due = now
        if self.child is not None:
            self.child.terminate()
            self._kill_at = now + self.process.grace

    def announced(self, now: float) -> None:
        """Note that it has announced itself on the bus."""
        if self.child is not None and self._kill_at is None:
            self.life.ready(now)

    def progressed(self, now: float) -> None:
        """Note that the start of the run goes on: its own start may take longer."""
        if self.life.state != "ready":
            self.life.reset_watchdog(now)

    def answered(self, now: float) -> None:
        """Note that it has replied to a ping."""
        if self.child is not None:
            self.life.answered(now)

    def take_output(self) -> list[LogLine]:
        """Return the lines to show; attempts while another process has its name are left out."""
        fresh = self.child.take_lines() if self.child else []
        if self.life.name_taken:
            self._held += fresh
        elif fresh or self._held:
            self._lines += [*self._held, *fresh]
            self._held.clear()
        lines, self._lines = self._lines, []
        return lines

    def _start(self, now: float) -> None:
        self._due, self._started, self._began = None, time.time(), time.monotonic()
        self.life.started(now)
        try:
            self.child = self._spawn(self.process, self.life.restarts)
        except OSError as error:
            # The machine has no file, process or memory left: the others fly on without this one.
            then = self._plan(now)
            self._log(f"{self.process.name} cannot be started ({error.strerror}): {then}")

    def _plan(self, now: float, code: int | None = None) -> str:
        """Plan the restart after an end that was not asked for, and return it as a clause."""
        delay = self.life.on_exit(now, code)
        self._due = None if delay is None else now + delay
        if self.life.name_taken:
            return f"another process has its name; retrying every {delay:g} s"
        return "left down" if delay is None else f"restarting in {delay:g} s"

    def _reap(self, now: float) -> None:
        child, stopped, was_taken = self.child, self._kill_at is not None, self.life.name_taken
        if child is None:
            return
        # The child's descendants must end, too, and close the pipe.
        child.kill()
        how = child.last_words()
        self.child = self._kill_at = None
        self._due = now
        then = "" if stopped else self._plan(now, child.exit_code())
        if was_taken and self.life.name_taken:
            self._held.clear()
            return
        self._lines += [*self._held, *child.take_lines()]
        self._held.clear()
        if not stopped:
            self._log(f"{self.process.name} ended ({how}): {then}")

    def _log(self, line: str) -> None:
        self._lines.append(LogLine(time.time(), "up", line, self.process.name))


_LOOK_EVERY = 0.2
"""Longest time (s) between checks, but for PING_EVERY while all are ready; a line, a start or an end wakes the loop."""
_ASLEEP = 2 * PING_EVERY
"""Time (s) between checks from which on this process itself was held up."""
_SAY_EVERY = 3.0
"""Seconds between reports of how far the start of several vehicles is."""
STARTING = "starting"
"""First word of such a report."""


class Supervisor:
    """Supervisor of a run's processes: one loop; threads only post to its inbox."""

    def __init__(self, launch: Launch, home: RunDirectory, logs: Logs) -> None:
        self._launch, self._home, self._logs = launch, home, logs
        self._inbox: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._rows = {
            process.name: ManagedProcess(process, self._spawn) for process in launch.processes()
        }
        self._mark = descendants.new_mark()
        self._watcher: fork.ForkedProcess | None = None
        self._liveness: LivenessProbe | None = None
        self._launched = self._progressed = self._said = time.monotonic()
        self._ready_nodes = 0
        self._stopped_by = 0
        self._woken = False
        self._next_ping = self._looked = 0.0
        self._written: list[ProcessRecord] = []

    def rows(self) -> list[ProcessRecord]:
        """Return the current records of the processes."""
        return [row.record() for row in self._rows.values()]

    def run(self, on_settled: Callable[[str], None], on_look: Callable[[], None]) -> int:
        """Run until a signal that is handled; return its number.

        `on_settled` is called once: with an empty text when all are ready, or with the last lines
        of the first process that is left down. `on_look` is called at each check. Raises
        AlreadyServed if the realm's folder was removed and another run has taken the realm.
        """
        settled = False
        try:
            # Fork all processes before any thread starts: a process with threads cannot fork.
            if fork.possible() and any(row.process.stranger for row in self._rows.values()):
                self._watcher = descendants.watch(self._mark)
            self._look(time.monotonic())
            self._listen()
            while not self._stopped_by:
                self._look(time.monotonic())
                if not settled:
                    self._say_progress(time.monotonic())
                    if (verdict := self._verdict()) is not None:
                        settled = True
                        on_settled(verdict)
                on_look()
                self._serve_inbox(PING_EVERY if self._are_ready() else _LOOK_EVERY)
        finally:
            self._stop_all()
        return self._stopped_by

    def stop(self, *, keep_logs: bool = False) -> None:
        """End the run as SIGTERM does; `keep_logs` leaves its logs in the realm's folder."""
        self._stopped_by, self._home.keeps_logs = signal.SIGTERM, keep_logs

    def handle_signals(self) -> None:
        """Let SIGINT, SIGTERM and SIGHUP end the run."""
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            # Under nohup a closed terminal must not end the run.
            if number and not (name == "SIGHUP" and signal.getsignal(number) == signal.SIG_IGN):
                signal.signal(number, self._on_signal)

    def _on_signal(self, number: int, _frame: Any) -> None:
        self._stopped_by = number
        self._inbox.put(self._wake)

    def _wake(self) -> None:
        """Check the children at once."""
        self._woken = True

    def _listen(self) -> None:
        for row in self._rows.values():
            if row.child is not None:
                row.child.listen()
        self._liveness = LivenessProbe(
            self._home.address,
            self._launch.vehicles,
            self._inbox.put,
            self._on_ready,
            self._on_answer,
            self._on_progress,
        )

    def _serve_inbox(self, timeout: float) -> None:
        deadline, self._woken = time.monotonic() + timeout, False
        with suppress(Empty):
            while not self._woken and (left := deadline - time.monotonic()) > 0:
                self._inbox.get(timeout=left)()

    def _verdict(self) -> str | None:
        now, limit = time.monotonic(), max(START_TIMEOUT, self._launch.answer_timeout)
        for name, row in self._rows.items():
            last = self._logs.last(name)
            if row.life.state == "down":
                return f"{name} does not stay up; its last lines:\n{last}"
            if row.life.name_taken and now - self._launched > QUICK:
                return f"another process has the name {name} already; its last lines:\n{last}"
            if now - self._progressed > limit and row.life.state != "ready":
                return (
                    f"{name} {NOT_READY}: {self._how_far()}, none of them in the last"
                    f" {limit:g} s\n{last}"
                )
        return "" if self._are_ready() else None

    def _are_ready(self) -> bool:
        return all(row.life.state == "ready" for row in self._rows.values())

    def _say_progress(self, now: float) -> None:
        if len(self._launch.vehicles) > 1 and now - self._said > _SAY_EVERY:
            self._said = now
            self._logs.show("up", f"{STARTING}: {self._how_far()}")

    def _how_far(self) -> str:
        announcing = sum(row.process.must_announce for row in self._rows.values())
        return f"{self._ready_nodes} of {announcing * len(self._launch.vehicles)} nodes are ready"

    def _look(self, now: float) -> None:
        for name in control.pending_restarts(self._home.realm):
            if name in self._rows:
                self._rows[name].restart(now, "restart requested")
        timeout = self._launch.answer_timeout
        # No answer arrives while this process does not run, or while no hub does.
        asleep = now - self._looked > _ASLEEP
        self._looked = now
        hub = self._rows.get("hub")
        self._excuse_waits()
        for row in self._rows.values():
            mute = row is not hub and cut_off(hub.life if hub else None, now, timeout)
            row.update(now, offline=asleep or mute, timeout=timeout)
        self._show()
        self._write_record()
        self._logs.look(now)
        if now >= self._next_ping:
            self._next_ping = now + PING_EVERY
            self._ping()
            self._repair_folder(now)

    def _excuse_waits(self) -> None:
        """Leave out of all limits the time in which a busy machine had no processor for a process.

        An answer comes through the hub; a process that starts may need any of the others.
        """
        waited = {name: row.waited() for name, row in self._rows.items()}
        longest, hub = max(waited.values(), default=0.0), waited.get("hub", 0.0)
        for name, row in self._rows.items():
            row.life.excuse(max(waited[name], hub) if row.life.state == "ready" else longest)
        self._launched += longest
        self._progressed += longest

    def _repair_folder(self, now: float) -> None:
        hub = self._rows.get("hub")
        try:
            repaired = self._home.repair(lambda line: self._logs.show("up", line))
        except AlreadyServed:
            # A SIGTERM would make our hub remove its socket, which belongs to the other run by now.
            if hub is not None and hub.child is not None:
                hub.child.kill()
            raise
        if repaired:
            self._logs.close()
            self._written = []
            if hub is not None:
                hub.restart(now, "its socket was removed: restarted")

    def _ping(self) -> None:
        timeout = self._launch.answer_timeout
        for name, row in self._rows.items():
            if self._liveness and row.life.state == "ready" and row.process.must_announce:
                self._liveness.ping(name, max(timeout, row.process.patience))

    def _spawn(self, process: Process, restarts: int) -> Child:
        self._logs.begin(process.name)
        child = Child(
            process,
            self._launch.environment(process.name, restarts),
            # Files in a user's folder steer no process of ours, as numba's .numba_config.yaml would.
            self._launch.folder if process.stranger else "/",
            self._mark,
            lambda: self._inbox.put(self._show),
            lambda: self._inbox.put(self._wake),
        )
        if self._liveness is not None:
            try:
                child.listen()
            except RuntimeError as error:  # no thread is left, as after the last process
                child.kill()
                raise OSError(errno.EAGAIN, str(error)) from error
        return child

    def _on_ready(self, name: str) -> None:
        if name in self._rows:
            self._rows[name].announced(time.monotonic())
            self._wake()

    def _on_progress(self, count: int) -> None:
        self._ready_nodes, self._progressed = count, time.monotonic()
        for row in self._rows.values():
            row.progressed(self._progressed)

    def _on_answer(self, name: str) -> None:
        if name in self._rows:
            self._rows[name].answered(time.monotonic())

    def _show(self) -> None:
        lines = [line for row in self._rows.values() for line in row.take_output()]
        for line in sorted(lines, key=lambda line: line.at):
            self._logs.show(line.name, line.line, line.at, line.about)

    def _write_record(self) -> None:
        rows = self.rows()
        # If the write fails, the next check tries again.
        if rows != self._written and self._logs.disk.try_write(lambda: self._home.write(rows)):
            self._written = rows

    def _stop_all(self) -> None:
        # The hub last, so that the others can still undeclare their endpoints.
        for names in (self._rows.keys() - {"hub"}, self._rows.keys() & {"hub"}):
            rows = [self._rows[name] for name in names]
            children = [(child, row.process.grace) for row in rows if (child := row.child)]
            for child, _ in children:
                child.terminate()
            terminated = time.monotonic()
            for child, grace in children:
                child.wait(terminated + grace - time.monotonic())
                # A child that has ended may have left descendants.
                child.kill()
                child.wait(GRACE)
                child.last_words()
        if self._liveness is not None:
            self._liveness.close()
        if self._watcher is not None:
            self._watcher.send_signal(signal.SIGKILL)
            # A busy machine may let it end only later, which changes nothing about this run's end.
            with suppress(subprocess.TimeoutExpired):
                self._watcher.wait(GRACE)
        self._show()
        self._logs.close()


def run(
    launch: Launch,
    emit: Emit,
    on_settled: Callable[[Supervisor, str], None],
    on_look: Callable[[Supervisor], None] | None = None,
) -> int:
    """Supervise until a signal, remove the run's files, and return the signal's number.

    Log lines go to `emit`. `on_look` is called at each check. Raises
    AlreadyServed if the realm is live.
    """
    with ExitStack() as stack:
        # From here on a signal ends the run in order, and none gets lost.
        with uninterrupted():
            home = stack.enter_context(RunDirectory(launch))
            logs = Logs(home.realm.logs, emit)
            supervisor = Supervisor(launch, home, logs)
            supervisor.handle_signals()
        return supervisor.run(
            lambda failed: on_settled(supervisor, failed),
            lambda: on_look(supervisor) if on_look else None,
        )
