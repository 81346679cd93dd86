"""Processes of a run, and the policy of their restarts. Pure."""

import re
import sys
from collections.abc import Collection, Mapping
from typing import Literal, NamedTuple

from quadctl.services.runtime.errors import AlreadyServed, Invalid

NODES = ("hub", "dynamics", "pressure", "safety")
"""Our own nodes, in the order in which they start; a new service is one more name."""

GATE = "gate"
"""Comes besides them where the hub is to be reached, or to join others, over a network."""
RECORDER = "recorder"
"""Comes besides them where a run is to be recorded."""

_NAME = r"[A-Za-z0-9_-]{1,40}"

State = Literal["starting", "ready", "restarting", "down"]

QUICK = 2.0
"""A death before readiness, or within this many seconds of it, is a quick one."""
HEALTHY = 10.0
"""Seconds of health after which earlier quick deaths are forgotten."""
MOST_QUICK_DEATHS = 5
START_TIMEOUT = 10.0
"""Seconds that a process may take to announce itself."""
GRACE = 0.3
"""Seconds that a process may take to end when asked, before it is killed."""
_RECORDERS_GRACE = 3.0
"""It has an index to write: of each hour that it has recorded, a quarter of a second."""
_GATES_PATIENCE = 10.0
"""Seconds that the gate may be silent for: thirty hubs that come back at once, as after each change of
the list of names, keep it busy for one or two, and who is killed then has them come once more."""
SETTLED = 1.0
"""Seconds that a command which announces nothing must run before it counts as ready."""
_DELAYS = (0.0, 0.1, 0.2, 0.4, 0.8)
"""Seconds before the restart after the first, second .. quick death in a row."""


class Process(NamedTuple):
    """A command to run under a name.

    `must_announce` where it is a node of ours or in the place of one; another command counts as
    ready when it has run for a moment. `stranger` where the file names the command. Asked to end, it
    has `grace` (s) to do so. Its silence counts after `patience` (s), where that is longer than
    everybody's.
    """

    name: str
    command: tuple[str, ...]
    must_announce: bool = True
    stranger: bool = False
    grace: float = GRACE
    patience: float = 0.0


def table(
    commands: Mapping[str, str | list[str]],
    without: Collection[str] = (),
    *,
    gate: bool = False,
    record: bool = False,
) -> tuple[Process, ...]:
    """Our nodes and the file's `[processes]`, which replace ours by name or come besides.

    The gate and the recorder are among ours where there is something for them to do.

    Raises Invalid for a name to leave out that is not there.
    """
    ours = (*NODES, *((GATE,) if gate else ()), *((RECORDER,) if record else ()))
    names = [*ours, *(name for name in commands if name not in ours)]
    for name in without:
        if name not in names:
            known = ", ".join(names)
            raise Invalid(f"--without {name}: there is no such process", f"one of {known}")
    for name in names:
        # `up` is the supervisor's own name in the log.
        if not re.fullmatch(_NAME, name) or name == "up":
            raise Invalid(f"processes.{name}: no name for a process", "use letters, digits, _, -")
    return tuple(
        Process(
            name,
            _command(name, commands),
            name in ours,
            name in commands,
            _RECORDERS_GRACE if name == RECORDER else GRACE,
            _GATES_PATIENCE if name == GATE else 0.0,
        )
        for name in names
        if name not in without
    )


def _command(name: str, commands: Mapping[str, str | list[str]]) -> tuple[str, ...]:
    command = commands.get(name)
    if command is None:
        # -P: a stranger's `services` folder in the working directory must not be found first.
        return (sys.executable, "-P", "-m", f"quadctl.services.{name}")
    import shlex

    try:
        words = shlex.split(command) if isinstance(command, str) else command
    except ValueError as error:
        raise Invalid(
            f"processes.{name}: {command} cannot be read: {error}", "quote it as for a shell"
        ) from error
    if not words:
        raise Invalid(f"processes.{name}: the command is empty", "leave the line out instead")
    return tuple(words)


class RestartPolicy:
    """One process's ups and downs; time (s) is passed in.

    The silence of one that `must_answer` counts from its readiness on, of another from its first
    answer: it may be a command that answers nobody.
    """

    def __init__(self, *, must_announce: bool = True, must_answer: bool = False) -> None:
        self.state: State = "starting"
        self.restarts = 0
        self.taken = False
        self._must_announce, self._must_answer = must_announce, must_answer
        self._deaths = 0
        self._started = 0.0
        self._ready_since: float | None = None
        self._answered: float | None = None

    def started(self, now: float) -> None:
        """It was started."""
        self._started, self._ready_since, self._answered = now, None, None

    def runs(self, now: float) -> None:
        """It is running; one that announces nothing is ready when it has done so for a moment."""
        if not self._must_announce and now - self._started >= SETTLED:
            self.ready(now)

    def ready(self, now: float) -> None:
        """It announced itself."""
        if self.state != "ready":
            self.state, self._ready_since, self.taken = "ready", now, False
            if self._must_answer:
                self._answered = now

    def answered(self, now: float) -> None:
        """It replied to a ping."""
        self._answered = now

    def reset_watchdog(self, now: float) -> None:
        """It could not have been heard until now."""
        if self._answered is not None:
            self._answered = now
        if self.state != "ready" and self._must_announce:
            self._started = now

    def timed_out(self, now: float, answer_timeout: float) -> str:
        """Why a running process has to be ended, empty when it does not."""
        if self.state != "ready":
            return (
                "" if now - self._started < START_TIMEOUT else f"not ready in {START_TIMEOUT:g} s"
            )
        silent = self._answered is not None and now - self._answered > answer_timeout
        return f"no answer for {answer_timeout:g} s" if silent else ""

    def on_exit(self, now: float, code: int | None = None) -> float | None:
        """It ended; returns after how many seconds to start it again, None to leave it down.

        With the exit code that says that another process has its name, it comes back whenever
        that one leaves, however long it takes.
        """
        lived = 0.0 if self._ready_since is None else now - self._ready_since
        self._ready_since = self._answered = None
        if lived >= HEALTHY:
            self._deaths = 0
        self.taken = self._must_announce and code == AlreadyServed.exit_code
        if self.taken:
            self.state = "restarting"
            self.restarts += 1
            return _DELAYS[-1]
        if lived < QUICK:
            self._deaths += 1
        if self._deaths >= MOST_QUICK_DEATHS:
            self.state = "down"
            return None
        self.state = "restarting"
        self.restarts += 1
        return _DELAYS[max(self._deaths - 1, 0)]

    def on_restart_request(self) -> None:
        """A restart was asked for: no death to be counted, and those before are forgotten."""
        self.state, self._deaths, self.taken = "restarting", 0, False
        self._ready_since = self._answered = None
        self.restarts += 1
