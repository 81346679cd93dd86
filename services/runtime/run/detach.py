"""Launching a run in the background, behind `quadctl up -d`."""

import signal
import subprocess
import sys
import threading
from typing import IO

import msgspec
from msgspec import Struct

from services.runtime.errors import AlreadyServed, Invalid, QuadctlError
from services.runtime.processes import START_TIMEOUT
from services.runtime.run import forked
from services.runtime.run.launch import Launch

_MODULE = "services.runtime.run.background"
_KILL = signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL


class Settled(Struct, frozen=True):
    """What a background supervisor says once: ready when `failed` is empty."""

    failed: str = ""
    code: str = ""
    hint: str = ""


def detach(launch: Launch) -> IO[bytes]:
    """Start a supervisor in the background, and return when it says that all are ready.

    What is returned holds a run that is `owned`: it ends when that is closed, as with this process.
    Raises AlreadyServed where the realm is live, Invalid for what cannot be launched, and
    QuadctlError with the last lines of what did not come up; then nothing is left running.
    """
    supervisor = _start()
    assert supervisor.stdin is not None  # noqa: S101 - pipes, as asked for below
    assert supervisor.stdout is not None  # noqa: S101
    patience = threading.Timer(2 * START_TIMEOUT, lambda: supervisor.send_signal(_KILL))
    patience.start()
    try:
        supervisor.stdin.write(msgspec.json.encode(launch) + b"\n")
        supervisor.stdin.flush()
        if not launch.owned:
            supervisor.stdin.close()
        said = supervisor.stdout.read()
    except BaseException:
        # Ctrl-C: what was begun is not left behind.
        supervisor.send_signal(signal.SIGTERM)
        raise
    finally:
        patience.cancel()
    settled = msgspec.json.decode(said or b"{}", type=Settled)
    for kind in (AlreadyServed, Invalid):
        if settled.code == kind.code:
            raise kind(settled.failed, settled.hint)
    if settled.failed or not said:
        supervisor.wait(START_TIMEOUT)
        raise QuadctlError(settled.failed or "the supervisor ended at once", settled.hint)
    return supervisor.stdin


def _start() -> subprocess.Popen[bytes] | forked.Forked:
    if forked.possible():
        return forked.Forked(_MODULE, {}, ".", both=False)
    return subprocess.Popen(
        (sys.executable, "-P", "-m", _MODULE),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
