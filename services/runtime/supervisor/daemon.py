"""Background supervisor of `up -d`: its start, and its main().

It reads a Launch, one line, from stdin, and writes a StartupReport, a line, to stdout every second,
until all are ready or one has failed. An owned run ends with its owner, on every platform: a kill -9
closes its stdin.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import msgspec
from msgspec import Struct

from quadctl.schemas.typed import from_json
from quadctl.services.runtime.errors import AlreadyServed, Invalid, QuadctlError, UsageError
from quadctl.services.runtime.process_table import START_TIMEOUT
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.supervisor.fork import ForkedProcess, possible as may_fork
from quadctl.services.runtime.supervisor.launch import Launch

if TYPE_CHECKING:
    from quadctl.services.runtime.supervisor.supervisor import Supervisor

_REPORT_EVERY = 1.0
"""Seconds between reports that the supervisor works, however slow the start is."""
_CAUSE = "its last lines name the cause"
_MODULE = "quadctl.services.runtime.supervisor.daemon"
_KILL = signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL


class StartupReport(Struct, frozen=True):
    """Report of a background supervisor, once `settled` the last one; empty `failed` means ready.

    Before that, `progress` may say how far the start of several vehicles is.
    """

    settled: bool = False
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
    report = StartupReport()
    watchdog = _watchdog(supervisor)
    try:
        supervisor.stdin.write(msgspec.json.encode(launch) + b"\n")
        supervisor.stdin.flush()
        if not launch.owned:
            supervisor.stdin.close()
        for line in supervisor.stdout:
            report = from_json(line, StartupReport)
            if report.settled:
                break
            watchdog.cancel()
            watchdog = _watchdog(supervisor)
            if report.progress:
                on_progress(report.progress)
    except BaseException:
        # After Ctrl-C nothing is left running.
        supervisor.send_signal(signal.SIGTERM)
        raise
    finally:
        watchdog.cancel()
        supervisor.stdout.close()
    if report.settled and not report.failed:
        return supervisor
    end(supervisor)
    for kind in (AlreadyServed, Invalid, UsageError):
        if report.code == kind.code:
            raise kind(report.failed, report.hint)
    raise QuadctlError(report.failed or "the supervisor ended before all was up", report.hint)


def end(supervisor: subprocess.Popen[bytes] | ForkedProcess) -> None:
    """Give up an owned run, and wait until its supervisor has ended."""
    if supervisor.stdin is not None:
        with contextlib.suppress(BrokenPipeError):
            supervisor.stdin.close()
    with contextlib.suppress(subprocess.TimeoutExpired):
        supervisor.wait(START_TIMEOUT)


def _watchdog(supervisor: subprocess.Popen[bytes] | ForkedProcess) -> threading.Timer:
    """Start the timer that kills a supervisor that reports nothing: it hangs."""
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
    launch = from_json(line, Launch)

    settled, reported = False, time.monotonic()

    def emit(name: str, line: str, _at: float) -> None:
        if name == "up" and line.startswith(STARTING) and not settled:
            _report(StartupReport(progress=line))

    def on_look(_supervisor: "Supervisor") -> None:
        nonlocal reported
        if not settled and time.monotonic() > reported + _REPORT_EVERY:
            reported = time.monotonic()
            _report(StartupReport())

    def on_settled(supervisor: "Supervisor", failed: str) -> None:
        nonlocal settled
        settled = True
        keep_logs = bool(failed) and not launch.owned
        hint = f"all lines are in {Realm(launch.realm).logs}" if keep_logs else _CAUSE
        if not _settle(StartupReport(settled=True, failed=failed, hint=hint)) or failed:
            supervisor.stop(keep_logs=keep_logs)
        elif launch.owned:
            # Only now, because a process with threads cannot fork its nodes.
            threading.Thread(target=_end_with_owner, args=(supervisor,), daemon=True).start()

    try:
        run(launch, emit, on_settled, on_look)
    except QuadctlError as error:
        _settle(StartupReport(settled=True, failed=error.message, code=error.code, hint=error.hint))
        return error.exit_code
    return 0


def _end_with_owner(supervisor: "Supervisor") -> None:
    os.read(0, 1)
    supervisor.stop()


def _report(report: StartupReport) -> bool:
    """Write to the command that waits; return False if the command has died."""
    try:
        os.write(1, msgspec.json.encode(report) + b"\n")
    except BrokenPipeError:
        return False
    return True


def _settle(report: StartupReport) -> bool:
    """Write the report as `_report`, and the last word: the command waits no longer."""
    if not _report(report):
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
