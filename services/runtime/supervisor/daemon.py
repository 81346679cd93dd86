"""Background supervisor of `up -d`: its start, and its main().

It reads a Launch, one line, from stdin, and writes one StartupResult to stdout when all are ready
or one has failed. An owned run ends with its owner, on every platform: a kill -9 closes its stdin.
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

from quadctl.services.runtime.errors import AlreadyServed, Invalid, QuadctlError, UsageError
from quadctl.services.runtime.process_table import START_TIMEOUT
from quadctl.services.runtime.supervisor import fork
from quadctl.services.runtime.supervisor.launch import Launch

if TYPE_CHECKING:
    from quadctl.services.runtime.supervisor.supervisor import Supervisor

_MODULE = "quadctl.services.runtime.supervisor.daemon"
_KILL = signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL


class StartupResult(Struct, frozen=True):
    """Result that a background supervisor reports once; empty `failed` means ready."""

    failed: str = ""
    code: str = ""
    hint: str = ""


def start_in_background(launch: Launch) -> IO[bytes]:
    """Start a supervisor in the background, and return when all processes are ready.

    An `owned` run ends when the returned pipe is closed, by the caller or by the caller's end.
    Raises AlreadyServed if the realm is live, Invalid if the launch is impossible, and QuadctlError
    with the last lines of a process that failed; then nothing is left running.
    """
    supervisor = _start()
    assert supervisor.stdin is not None  # noqa: S101 - Popen was given pipes
    assert supervisor.stdout is not None  # noqa: S101
    watchdog = threading.Timer(2 * START_TIMEOUT, lambda: supervisor.send_signal(_KILL))
    watchdog.start()
    try:
        supervisor.stdin.write(msgspec.json.encode(launch) + b"\n")
        supervisor.stdin.flush()
        if not launch.owned:
            supervisor.stdin.close()
        reply = supervisor.stdout.read()
    except BaseException:
        # After Ctrl-C nothing is left running.
        supervisor.send_signal(signal.SIGTERM)
        raise
    finally:
        watchdog.cancel()
    result = msgspec.json.decode(reply or b"{}", type=StartupResult)
    for kind in (AlreadyServed, Invalid, UsageError):
        if result.code == kind.code:
            raise kind(result.failed, result.hint)
    if result.failed or not reply:
        supervisor.wait(START_TIMEOUT)
        raise QuadctlError(result.failed or "the supervisor ended at once", result.hint)
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

    # sys.stdin is None if the shell has closed it (`quadctl up -d <&-`).
    with os.fdopen(0, "rb", closefd=False) as pipe:
        line = pipe.readline()
    if not line.endswith(b"\n"):
        return 0  # the command was killed while it wrote
    launch = msgspec.json.decode(line, type=Launch)

    def on_settled(supervisor: "Supervisor", failed: str) -> None:
        if not _report(StartupResult(failed)) or failed:
            supervisor.stop()
        elif launch.owned:
            # Only now, because a process with threads cannot fork its nodes.
            threading.Thread(target=_end_with_owner, args=(supervisor,), daemon=True).start()

    try:
        with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
            run(launch, nowhere, on_settled)
    except QuadctlError as error:
        _report(StartupResult(error.message, error.code, error.hint))
        return error.exit_code
    return 0


def _end_with_owner(supervisor: "Supervisor") -> None:
    os.read(0, 1)
    supervisor.stop()


def _report(result: StartupResult) -> bool:
    """Write the result for the command that waits; return False if the command has died."""
    try:
        os.write(1, msgspec.json.encode(result))
    except BrokenPipeError:
        return False
    # Closing stdout ends the command's read. Stderr is inherited from the command: a caller that
    # captures it would wait as long as we run.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (2, 1):
        os.dup2(nowhere, stream)
    os.close(nowhere)
    return True


if __name__ == "__main__":
    sys.exit(main())
