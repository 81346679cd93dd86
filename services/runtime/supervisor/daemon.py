"""Background supervisor of `up -d`: its start, and its main().

It reads a Launch, one line, from stdin, and writes a StartupResult, a line, to stdout when all are
ready or one has failed; before that, some with the progress of several vehicles. An owned run ends
with its owner, on every platform: a kill -9 closes its stdin.
"""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
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
    """Report of a background supervisor: `progress`, or the result; empty `failed` means ready."""

    progress: str = ""
    failed: str = ""
    code: str = ""
    hint: str = ""


def start_in_background(launch: Launch, on_progress: Callable[[str], None]) -> IO[bytes]:
    """Start a supervisor in the background, and return when all processes are ready.

    `on_progress` gets a line each few seconds if the start of several vehicles takes that long.
    An `owned` run ends when the returned pipe is closed, by the caller or by the caller's end.
    Raises AlreadyServed if the realm is live, Invalid if the launch is impossible, and QuadctlError
    with the last lines of a process that failed; then nothing is left running.
    """
    supervisor = _start()
    assert supervisor.stdin is not None  # noqa: S101 - Popen was given pipes
    assert supervisor.stdout is not None  # noqa: S101
    result: StartupResult | None = None
    watchdog = _watchdog(supervisor)
    try:
        supervisor.stdin.write(msgspec.json.encode(launch) + b"\n")
        supervisor.stdin.flush()
        if not launch.owned:
            supervisor.stdin.close()
        for line in supervisor.stdout:
            result = msgspec.json.decode(line, type=StartupResult)
            if not result.progress:
                break
            watchdog.cancel()
            watchdog = _watchdog(supervisor)
            on_progress(result.progress)
    except BaseException:
        # After Ctrl-C nothing is left running.
        supervisor.send_signal(signal.SIGTERM)
        raise
    finally:
        watchdog.cancel()
    result = result or StartupResult(failed="the supervisor ended at once")
    for kind in (AlreadyServed, Invalid, UsageError):
        if result.code == kind.code:
            raise kind(result.failed, result.hint)
    if result.progress or result.failed:
        supervisor.wait(START_TIMEOUT)
        raise QuadctlError(result.failed or "the supervisor ended before all was up", result.hint)
    return supervisor.stdin


def _watchdog(supervisor: subprocess.Popen[bytes] | fork.ForkedProcess) -> threading.Timer:
    """Start the timer that kills a supervisor that reports nothing."""
    timer = threading.Timer(2 * START_TIMEOUT, lambda: supervisor.send_signal(_KILL))
    timer.start()
    return timer


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
    from quadctl.services.runtime.supervisor.supervisor import STARTING, run

    # sys.stdin is None if the shell has closed it (`quadctl up -d <&-`).
    with os.fdopen(0, "rb", closefd=False) as pipe:
        line = pipe.readline()
    if not line.endswith(b"\n"):
        return 0  # the command was killed while it wrote
    launch = msgspec.json.decode(line, type=Launch)

    settled = False

    def emit(name: str, line: str, _at: float) -> None:
        if name == "up" and line.startswith(STARTING) and not settled:
            _report(StartupResult(progress=line))

    def on_settled(supervisor: "Supervisor", failed: str) -> None:
        nonlocal settled
        settled = True
        if not _settle(StartupResult(failed=failed)) or failed:
            supervisor.stop()
        elif launch.owned:
            # Only now, because a process with threads cannot fork its nodes.
            threading.Thread(target=_end_with_owner, args=(supervisor,), daemon=True).start()

    try:
        run(launch, emit, on_settled)
    except QuadctlError as error:
        _settle(StartupResult(failed=error.message, code=error.code, hint=error.hint))
        return error.exit_code
    return 0


def _end_with_owner(supervisor: "Supervisor") -> None:
    os.read(0, 1)
    supervisor.stop()


def _report(result: StartupResult) -> bool:
    """Write to the command that waits; return False if the command has died."""
    try:
        os.write(1, msgspec.json.encode(result) + b"\n")
    except BrokenPipeError:
        return False
    return True


def _settle(result: StartupResult) -> bool:
    """Write the result as `_report`, and the last word: the command waits no longer."""
    if not _report(result):
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
