"""Processes of a run and the policy of their restarts, without side effects."""

import sys
from collections.abc import Collection, Mapping
from typing import Literal, NamedTuple

from quadctl.schemas.roles import BRIDGES
from quadctl.services.runtime.errors import AlreadyServed, Invalid

NODES = ("hub", "dynamics", "pressure", "safety")
"""Our own nodes, in the order in which they start; a new service is one more name."""
GATE = "gate"
"""Additional node of a hub that listens, or connects to other hubs, over a network."""
RECORDER = "recorder"
"""Additional node of a run that is recorded."""

_NAME = r"[A-Za-z0-9_-]{1,40}"

State = Literal["starting", "ready", "restarting", "down"]

QUICK = 2.0
"""Seconds after readiness; a death before or within them is a quick one."""
HEALTHY = 10.0
"""Seconds of health after which earlier quick deaths are forgotten."""
MOST_QUICK_DEATHS = 5
NOT_READY = "is not ready"
"""Part of a supervisor's line on a process that is up, and has not announced itself in time."""
START_TIMEOUT = 10.0
"""Seconds in which a process must announce itself."""
GRACE = 0.3
"""Seconds that a process has to end when asked, before it is killed."""
_RECORDERS_GRACE = 3.0
"""Seconds; the recorder writes an index, 0.25 s for each hour that it has recorded."""
_HUBS_PATIENCE = 0.02
"""Seconds for each vehicle that the hub may be silent: some fifty declarations of each keep it busy when
the run starts, and all of them again when it comes back itself."""
_GATES_PATIENCE = 10.0
"""Seconds that the gate may be silent: 30 hubs that reconnect at once, e.g. after a change of the
list of names, keep it busy for 1-2 s; killing it then makes all of them reconnect again."""
SETTLED = 1.0
"""Seconds that a command which announces nothing must run before it counts as ready."""
PING_EVERY = 0.5
"""Seconds between pings of a process."""
_DELAYS = (0.0, 0.1, 0.2, 0.4, 0.8)
"""Seconds before the restart after the first, second, ... quick death in a row."""


class Process(NamedTuple):
    """Command to run under a name.

    `must_announce`: one of our nodes or its replacement; other commands are ready after `SETTLED`.
    `stranger`: the file gives the command. `grace`: time (s) to end when asked. `patience`: silence
    (s) that is allowed, if longer than the general limit.
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
    bridges: Collection[str] = (),
    vehicles: int = 1,
) -> tuple[Process, ...]:
    """Return our nodes and the file's `[processes]`, which replace ours by name or are added.

    Raises Invalid for an unknown name in `without`, and for one that looks like a misspelt node.
    """
    ours = (*NODES, *((GATE,) if gate else ()), *((RECORDER,) if record else ()), *bridges)
    names = [*ours, *(name for name in commands if name not in ours)]
    for name in without:
        if name not in names:
            hint = f"one of {', '.join(names)}"
            raise Invalid(f"--without {name}: there is no such process", hint)
    patience = {"hub": _HUBS_PATIENCE * vehicles, GATE: _GATES_PATIENCE}
    import re  # takes 6 ms, and most commands only need the names of our nodes

    for name in names:
        # `up` is the supervisor's own name in the log.
        if not re.fullmatch(_NAME, name) or name == "up":
            raise Invalid(f"processes.{name}: not a process name", "use letters, digits, _, -")
        if meant := "" if name in ours else _misspelt(name, ours):
            raise Invalid(
                f"processes.{name}: there is no node of ours named {name}",
                f"did you mean {meant}? another node needs a name less like it, e.g. {meant}_2",
            )
    return tuple(
        Process(
            name,
            _command(name, commands),
            name in ours,
            name in commands,
            _RECORDERS_GRACE if name == RECORDER else GRACE,
            patience.get(name, 0.0),
        )
        for name in names
        if name not in without
    )


def _misspelt(name: str, ours: Collection[str]) -> str:
    """Return the node of ours that a name is likely meant to be, or an empty text."""
    import difflib

    near = difflib.get_close_matches(name.lower(), ours, n=1, cutoff=0.8)
    return near[0] if near and name.isalpha() else ""


def _command(name: str, commands: Mapping[str, str | list[str]]) -> tuple[str, ...]:
    command = commands.get(name)
    if command is None:
        # -P: a `services` folder in the working directory must not hide ours.
        package = f"bridges.{name}" if name in BRIDGES else name
        return (sys.executable, "-P", "-m", f"quadctl.services.{package}")
    import shlex

    try:
        words = shlex.split(command) if isinstance(command, str) else command
    except ValueError as error:
        raise Invalid(
            f"processes.{name}: {command} cannot be parsed: {error}", "quote it as for a shell"
        ) from error
    if not words:
        raise Invalid(f"processes.{name}: the command is empty", "remove the line instead")
    if any("\0" in word for word in words):
        raise Invalid(f"processes.{name}: the command has a NUL", "no program takes one: remove it")
    return tuple(words)


class RestartPolicy:
    """State of one process and the policy of its restarts; time (s) is passed in.

    Silence counts from readiness if it `must_answer`, else from its first answer, if any comes. Time in
    which it waits for a processor counts nowhere: that is no fault of a process. See `excuse`.
    """

    def __init__(self, *, must_announce: bool = True, must_answer: bool = False) -> None:
        self.state: State = "starting"
        self.restarts = 0
        self.name_taken = False
        self._must_announce, self._must_answer = must_announce, must_answer
        self._deaths = 0
        self._started = 0.0
        self._ready_since: float | None = None
        self._answered: float | None = None

    def started(self, now: float) -> None:
        """Record its start."""
        self._started, self._ready_since, self._answered = now, None, None

    def runs(self, now: float) -> None:
        """Record that it runs; if it announces nothing, it is ready after `SETTLED`."""
        if not self._must_announce and now - self._started >= SETTLED:
            self.ready(now)

    def ready(self, now: float) -> None:
        """Record its announcement."""
        if self.state != "ready":
            self.state, self._ready_since, self.name_taken = "ready", now, False
            if self._must_answer:
                self._answered = now

    def answered(self, now: float) -> None:
        """Record its reply to a ping."""
        self._answered = now

    def silence(self, now: float) -> float:
        """Return the time (s) since its last reply or readiness; 0 if it need not reply yet."""
        return 0.0 if self._answered is None else now - self._answered

    def reset_watchdog(self, now: float) -> None:
        """Restart its timeouts, as no message of it could arrive until now."""
        if self._answered is not None:
            self._answered = now
        if self.state != "ready" and self._must_announce:
            self._started = now

    def excuse(self, seconds: float) -> None:
        """Leave out so many seconds of its past: it could not run, or its messages could not arrive."""
        self._started += seconds
        if self._ready_since is not None:
            self._ready_since += seconds
        if self._answered is not None:
            self._answered += seconds

    def timed_out(self, now: float, answer_timeout: float) -> str:
        """Return why a running process must be ended; empty if it need not."""
        if self.state != "ready":
            limit = max(START_TIMEOUT, answer_timeout)
            return f"not ready in {limit:g} s" if now - self._started >= limit else ""
        return f"no answer for {answer_timeout:g} s" if self.silence(now) > answer_timeout else ""

    def on_exit(self, now: float, code: int | None = None) -> float | None:
        """Record its end; return the delay (s) of its restart, or None to leave it down.

        While another process has its name, seen by the exit code, it is restarted without limit.
        """
        lived = 0.0 if self._ready_since is None else now - self._ready_since
        self._ready_since = self._answered = None
        if lived >= HEALTHY:
            self._deaths = 0
        self.name_taken = self._must_announce and code == AlreadyServed.exit_code
        if lived < QUICK and not self.name_taken:
            self._deaths += 1
            if self._deaths >= MOST_QUICK_DEATHS:
                self.state = "down"
                return None
        self.state = "restarting"
        self.restarts += 1
        return _DELAYS[-1 if self.name_taken else max(self._deaths - 1, 0)]

    def on_restart_request(self) -> None:
        """Record a requested restart: it is no death, and earlier deaths are forgotten."""
        self.state, self._deaths, self.name_taken = "restarting", 0, False
        self._ready_since = self._answered = None
        self.restarts += 1


def cut_off(hub: RestartPolicy | None, now: float, answer_timeout: float) -> bool:
    """Return whether the replies of the other processes may have stuck in the hub, if there is one.

    The replies to one ping come at different moments, so the others may seem silent a little longer
    than a frozen hub. They are excused as soon as the hub itself has missed a ping or two.
    """
    late = max(answer_timeout / 2, PING_EVERY)
    return hub is not None and (hub.state != "ready" or hub.silence(now) > late)
