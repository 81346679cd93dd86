"""Temporary run of a command; it ends with the command, however the command ends."""

import contextlib
import signal
import sys
from collections.abc import Callable, Iterator
from typing import Any

from msgspec.structs import replace

from quadctl.cli import output
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.supervisor.control import stop_run
from quadctl.services.runtime.supervisor.daemon import end, start_in_background
from quadctl.services.runtime.supervisor.launch import Launch

_ENDINGS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""Signals beside Ctrl-C that end a command; Python by itself would exit without cleaning up."""


@contextlib.contextmanager
def temporary_run(launch: Launch) -> Iterator[Realm]:
    """Start a run and end it with the block, on a signal too; raise as start_in_background."""
    realm = Realm(launch.realm)
    with leaving() as stay:
        supervisor = start_in_background(replace(launch, owned=True), output.note)
        try:
            yield realm
        finally:
            stay()
            stop_run(realm)
            end(supervisor)


@contextlib.contextmanager
def leaving() -> Iterator[Callable[[], None]]:
    """Let signals that end a command raise SystemExit in the block; yield a function that ignores them from then on."""
    # Under nohup a closed terminal must not end the run.
    handled = [number for number in _ENDINGS if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, _leave) for number in handled}

    def stay() -> None:
        for number in handled:
            signal.signal(number, signal.SIG_IGN)

    try:
        yield stay
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _leave(number: int, _frame: Any) -> None:
    sys.exit(128 + number)
