"""Ending a run from outside."""

import contextlib
import os
import signal
import time

from services.runtime import vitals
from services.runtime.errors import TimedOut
from services.runtime.realm import Realm
from services.runtime.record import RunRecord, is_live, read

_POLL = 0.005


def halt(realm: Realm, timeout: float = 5.0) -> RunRecord:
    """End a run and wait (s) until it has ended; raises Unreachable where nothing runs."""
    run = read(realm)
    # It may be ending by itself just now.
    with contextlib.suppress(ProcessLookupError):
        os.kill(run.pid, signal.SIGTERM)
    deadline = time.monotonic() + timeout
    while is_live(realm) or _is_there(run.pid):
        if time.monotonic() > deadline:
            raise TimedOut(
                f"process {run.pid} has not ended within {timeout:g} s",
                f"wait longer with --timeout, or kill -9 {run.pid}: its children end by themselves",
            )
        time.sleep(_POLL)
    return run


def _is_there(pid: int) -> bool:
    # It lets go of the realm first. Where nothing is told of processes, that has to do.
    return vitals.parent_of(pid) is not None and not vitals.has_ended(pid)
