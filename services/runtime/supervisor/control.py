"""Requests to a run from outside: restart a process, stop the run."""

import contextlib
import os
import signal
import time

from quadctl.services.runtime import procfs, run_files
from quadctl.services.runtime.errors import Invalid, QuadctlError, TimedOut
from quadctl.services.runtime.params.names import nearest
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import ProcessRecord, RunState, is_live, read

_STOP_POLL = 0.005
_REMOVAL = 0.015
"""Seconds in which a busy disk removes the five files of a vehicle."""


def stop_run(realm: Realm, timeout: float = 5.0) -> RunState:
    """Stop a run and wait (s) until it has ended; raises Unreachable if nothing runs.

    A run of several vehicles has longer, by the time that it takes to remove its files.
    """
    run = read(realm)
    # The run may end by itself at this moment.
    with contextlib.suppress(ProcessLookupError):
        os.kill(run.pid, signal.SIGTERM)
    timeout += _REMOVAL * (len(run.vehicles) - 1)
    deadline = time.monotonic() + timeout
    while is_live(realm) or _is_there(run.pid):
        if time.monotonic() > deadline:
            hint = (
                f"wait longer with --timeout, or kill -9 {run.pid}: its children end by themselves"
            )
            if procfs.is_frozen(run.pid):
                hint = f"it is frozen (stopped by a signal): `kill -CONT {run.pid}`"
            raise TimedOut(f"process {run.pid} has not ended within {timeout:g} s", hint)
        time.sleep(_STOP_POLL)
    return run


def _is_there(pid: int) -> bool:
    # A supervisor releases the realm before it ends. Without /proc only the realm can be checked.
    return procfs.parent_of(pid) is not None and not procfs.has_ended(pid)


_POLL = 0.01


def request_restart(realm: Realm, name: str) -> ProcessRecord:
    """Leave a request for the supervisor, and return the record of the process before it.

    Raises Unreachable if nothing runs, and Invalid for a name that the run does not have.
    """
    before = _process(realm, name)
    try:
        realm.restart_requests.mkdir(exist_ok=True)
        # An empty file appears at once, and needs no room on a full disk.
        (realm.restart_requests / name).touch()
    except FileNotFoundError as error:
        raise run_files.not_running(realm) from error
    except OSError as error:
        raise QuadctlError(
            f"{realm.restart_requests} cannot be written: {error.strerror}", "is the disk full?"
        ) from error
    return before


def pending_restarts(realm: Realm) -> list[str]:
    """Take the names requested since the last call; the supervisor calls this at each check."""
    if not realm.restart_requests.exists():
        return []
    names = []
    # A request that arrives just now, or the removal of the folder, waits for the next call.
    with contextlib.suppress(OSError):
        for request in realm.restart_requests.iterdir():
            request.unlink()
            names.append(request.name)
    return names


def wait_restarted(realm: Realm, name: str, before: ProcessRecord, timeout: float) -> ProcessRecord:
    """Wait (s) until it is ready as another process than `before`, and return its new record.

    Raises TimedOut, and QuadctlError if it was started but does not stay up.
    """
    deadline = time.monotonic() + timeout
    hint = f"look for the cause in its log: {realm.logs / f'{name}.log'}"
    while True:
        now = _process(realm, name)
        if now.restarts > before.restarts and now.state == "down":
            raise QuadctlError(f"{name} was restarted and does not stay up", hint)
        if now.state == "ready" and now.pid not in {0, before.pid}:
            return now
        if time.monotonic() > deadline:
            late = f"{name} is not ready again within {timeout:g} s, but {now.state}"
            raise TimedOut(late, hint)
        time.sleep(_POLL)


def _process(realm: Realm, name: str) -> ProcessRecord:
    nodes = {node.name: node for node in run_files.read(realm).nodes}
    if name not in nodes:
        raise Invalid(
            f"{name}: there is no such process in the realm {realm.name}",
            nearest(name, nodes) or f"there are {', '.join(nodes)}",
        )
    return nodes[name]
