"""Background supervisor of `up -d`: its start, and its main().

It reads a Launch, one line, from stdin, and writes a StartupResult, a line, to stdout when all are
ready or one has failed; before that, some with the progress of several vehicles. An owned run ends
with its owner, on every platform: a kill -9 closes its stdin.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import msgspec
from msgspec import Struct

from quadctl.services.runtime.errors import AlreadyServed, Invalid, QuadctlError, UsageError
from quadctl.services.runtime.process_table import START_TIMEOUT
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.supervisor.fork import ForkedProcess
from quadctl.services.runtime.supervisor.fork import possible as may_fork
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


def start_in_background(
    launch: Launch, on_progress: Callable[[str], None], *, fork: bool = True
) -> subprocess.Popen[bytes] | ForkedProcess:
    """Start a supervisor in the background, and return when all processes are ready.

    With `fork` it may begin as a copy of this process, which must then be a command of ours.
    `on_progress` gets a line each few seconds if the start of several vehicles takes that long.
    An `owned` run ends when its supervisor's stdin is closed, by the caller or by the caller's end.
    Raises AlreadyServed if the realm is live, Invalid if the launch is impossible, and QuadctlError
    with the last lines of a process that failed; then nothing is left running, and only the logs
    of a run that is not `owned` are left in its folder.
    """
    supervisor = _start(fork=fork)
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
        supervisor.stdout.close()
    result = result or StartupResult(failed="the supervisor ended at once")
    if result.progress or result.failed:
        end(supervisor)
    for kind in (AlreadyServed, Invalid, UsageError):
        if result.code == kind.code:
            raise kind(result.failed, result.hint)
    if result.progress or result.failed:
        raise QuadctlError(result.failed or "the supervisor ended before all was up", result.hint)
    return supervisor


def end(supervisor: subprocess.Popen[bytes] | ForkedProcess) -> None:
    """Give up an owned run, and wait until its supervisor has ended."""
    if supervisor.stdin is not None:
        with contextlib.suppress(BrokenPipeError):
            supervisor.stdin.close()
    with contextlib.suppress(subprocess.TimeoutExpired):
        supervisor.wait(START_TIMEOUT)


def _watchdog(supervisor: subprocess.Popen[bytes] | ForkedProcess) -> threading.Timer:
    """Start the timer that kills a supervisor that reports nothing."""
    timer = threading.Timer(2 * START_TIMEOUT, lambda: supervisor.send_signal(_KILL))
    timer.start()
    return timer


def _start(*, fork: bool) -> subprocess.Popen[bytes] | ForkedProcess:
    if fork and may_fork():
        return ForkedProcess(_MODULE, {}, ".", both=False)
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
        keep_logs = bool(failed) and not launch.owned
        hint = f"all lines are in {Realm(launch.realm).logs}" if keep_logs else ""
        if not _settle(StartupResult(failed=failed, hint=hint)) or failed:
            supervisor.stop(keep_logs=keep_logs)
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
