"""Launching a run in the background, behind `quadctl up -d`."""

import subprocess
import sys
import threading

import msgspec
from msgspec import Struct

from services.runtime.errors import AlreadyServed, QuadctlError
from services.runtime.launch import Launch
from services.runtime.processes import START_TIMEOUT


class Settled(Struct, frozen=True):
    """What a background supervisor says once: ready when `failed` is empty."""

    failed: str = ""
    code: str = ""
    hint: str = ""


def detach(launch: Launch) -> None:
    """Start a supervisor in the background, and return when it says that all are ready.

    Raises AlreadyServed where the realm is live, and QuadctlError with the last lines of what
    did not come up; then nothing is left running.
    """
    supervisor = subprocess.Popen(
        [sys.executable, "-P", "-m", "services.runtime.background"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    assert supervisor.stdin is not None  # noqa: S101 - pipes, as asked for above
    assert supervisor.stdout is not None  # noqa: S101
    patience = threading.Timer(2 * START_TIMEOUT, supervisor.kill)
    patience.start()
    try:
        supervisor.stdin.write(msgspec.json.encode(launch))
        supervisor.stdin.close()
        said = supervisor.stdout.read()
    except BaseException:
        # Ctrl-C: what was begun is not left behind.
        supervisor.terminate()
        raise
    finally:
        patience.cancel()
    settled = msgspec.json.decode(said or b"{}", type=Settled)
    if settled.code == AlreadyServed.code:
        raise AlreadyServed(settled.failed, settled.hint)
    if settled.failed or not said:
        supervisor.wait()
        raise QuadctlError(settled.failed or "the supervisor ended at once", settled.hint)
