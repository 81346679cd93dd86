"""One row of the process table at work."""

import time
from collections import deque
from collections.abc import Callable

from services.runtime.processes import GRACE, Life, Process
from services.runtime.record import ProcessRecord
from services.runtime.run.child import Child
from services.runtime.run.lines import MOST, Said


class Row:
    """A process, its life, and the child that is running it now, if any; time (s) is passed in."""

    def __init__(self, process: Process, spawn: Callable[[Process, int], Child]) -> None:
        """`spawn` starts the process, after so many restarts."""
        self.process, self._spawn = process, spawn
        self.life = Life(must_announce=process.must_announce, must_answer=not process.stranger)
        self.child: Child | None = None
        self._due: float | None = 0.0
        self._started = 0.0
        self._kill_at: float | None = None
        self._said: list[Said] = []
        self._held: deque[Said] = deque(maxlen=MOST)

    def record(self) -> ProcessRecord:
        """The row of the run record."""
        pid, started = (self.child.pid, self._started) if self.child else (0, 0.0)
        life = self.life
        return ProcessRecord(self.process.name, pid, life.state, life.restarts, started)

    def turn(self, now: float, *, deaf: bool, answer_timeout: float) -> None:
        """Start it when that is due, see whether it has ended, end it when it must be.

        `deaf` says that it could not have been heard lately.
        """
        if self.child is None:
            if self._due is not None and now >= self._due:
                self._start(now)
            return
        if self.child.exit_code() is not None:
            self._bury(now)
            return
        if self._kill_at is not None:
            if now >= self._kill_at:
                self.child.kill()
            return
        self.life.runs(now)
        if deaf:
            self.life.excuse(now)
        elif why := self.life.complaint(now, max(answer_timeout, self.process.patience)):
            self._tell(f"{self.process.name}: {why}: killed")
            self.child.kill()
            self.child.wait(GRACE)
            self._bury(now)

    def restart(self, now: float, why: str) -> None:
        """End it, where it runs, and start it anew at once."""
        if self._kill_at is not None:
            return
        self._tell(f"{self.process.name}: {why}")
        self.life.asked()
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

    def take_said(self) -> list[Said]:
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

    def _bury(self, now: float) -> None:
        child, asked, was_taken = self.child, self._kill_at is not None, self.life.taken
        if child is None:
            return
        # What it has started goes with it, and lets go of its pipe.
        child.kill()
        how = child.last_words()
        self.child = self._kill_at = None
        delay = 0.0 if asked else self.life.died(now, child.exit_code())
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
        self._tell(f"{self.process.name} ended ({how}): {then}")

    def _tell(self, line: str) -> None:
        self._said.append(Said(time.time(), "up", line))
