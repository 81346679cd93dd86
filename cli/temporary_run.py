"""A run of a command's own, ended with the command however that ends."""

import contextlib
import signal
import sys
from collections.abc import Iterator
from typing import Any

from msgspec.structs import replace

from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.supervisor.control import stop_run
from quadctl.services.runtime.supervisor.daemon import start_in_background
from quadctl.services.runtime.supervisor.launch import Launch

_ENDINGS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""What else than Ctrl-C may end a command; by itself Python would let nothing be put in order."""


@contextlib.contextmanager
def run_of_its_own(launch: Launch) -> Iterator[Realm]:
    """Start a run, and end it with the block, by a signal too; raises as detach does."""
    realm = Realm(launch.realm)
    # With nohup a closed terminal is to end nothing.
    heeded = [number for number in _ENDINGS if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, _leave) for number in heeded}
    try:
        leash = start_in_background(replace(launch, owned=True))
        try:
            yield realm
        finally:
            for number in heeded:
                signal.signal(number, signal.SIG_IGN)
            stop_run(realm)
            leash.close()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _leave(number: int, _frame: Any) -> None:
    sys.exit(128 + number)
