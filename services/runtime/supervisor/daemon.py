"""Background supervisor of `up -d`: its start, and its main().

Reads a Launch, one line, from stdin, and writes one StartupResult to stdout when all are ready or one
failed. An owned run ends when its stdin does: with its owner, even by kill -9, on every platform.
"""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import IO, TYPE_CHECKING

import msgspec
from msgspec import Struct

from quadctl.services.runtime.errors import AlreadyServed, Invalid, QuadctlError
from quadctl.services.runtime.process_table import START_TIMEOUT
from quadctl.services.runtime.supervisor import fork
from quadctl.services.runtime.supervisor.launch import Launch

if TYPE_CHECKING:
    from quadctl.services.runtime.supervisor.supervisor import Supervisor

_MODULE = "quadctl.services.runtime.supervisor.daemon"
_KILL = signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL


class StartupResult(Struct, frozen=True):
    """What a background supervisor says once: ready when `failed` is empty."""

    failed: str = ""
    code: str = ""
    hint: str = ""


def start_in_background(launch: Launch) -> IO[bytes]:
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
    settled = msgspec.json.decode(said or b"{}", type=StartupResult)
    for kind in (AlreadyServed, Invalid):
        if settled.code == kind.code:
            raise kind(settled.failed, settled.hint)
    if settled.failed or not said:
        supervisor.wait(START_TIMEOUT)
        raise QuadctlError(settled.failed or "the supervisor ended at once", settled.hint)
    return supervisor.stdin


def _start() -> subprocess.Popen[bytes] | fork.ForkedProcess:
    if fork.possible():
        return fork.ForkedProcess(_MODULE, {}, ".", both=False)
    return subprocess.Popen(
        (sys.executable, "-P", "-m", _MODULE),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )


def main() -> int:
    """Run a realm in the background."""
    from quadctl.services.runtime.supervisor.supervisor import run

    # Not sys.stdin, which is None where the shell had closed it (`quadctl up -d <&-`).
    with os.fdopen(0, "rb", closefd=False) as pipe:
        asked = pipe.readline()
    if not asked.endswith(b"\n"):
        return 0  # who asked was killed over it
    launch = msgspec.json.decode(asked, type=Launch)

    def on_settled(supervisor: "Supervisor", failed: str) -> None:
        if not _say(StartupResult(failed)) or failed:
            supervisor.stop()
        elif launch.owned:
            # Not before: a process with threads cannot fork its nodes.
            threading.Thread(target=_end_with_owner, args=(supervisor,), daemon=True).start()

    try:
        with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
            run(launch, nowhere, on_settled)
    except QuadctlError as error:
        _say(StartupResult(error.message, error.code, error.hint))
        return error.exit_code
    return 0


def _end_with_owner(supervisor: "Supervisor") -> None:
    os.read(0, 1)
    supervisor.stop()


def _say(settled: StartupResult) -> bool:
    """Whether who waits for it is still there to hear it."""
    try:
        os.write(1, msgspec.json.encode(settled))
    except BrokenPipeError:
        return False
    # Letting go of stdout tells the reader that this was all; stderr is the command's own, and
    # who captures it would wait for its end as long as we run.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (2, 1):
        os.dup2(nowhere, stream)
    os.close(nowhere)
    return True


if __name__ == "__main__":
    sys.exit(main())
