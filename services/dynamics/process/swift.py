"""The compiled text for the vehicles of this process, as soon as it is there; nobody waits for it."""

import logging
import sys
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from services.dynamics.fleet.single import Single
    from services.dynamics.process.machine import Machine

_MAKING = (sys.executable, "-P", "-m", "services.dynamics.process.making")

_log = logging.getLogger(__name__)


def have_made() -> None:
    """Have the machine code made where there is none; returns when that is done, or has failed."""
    import subprocess

    # It ends when its stdin does, which is at the latest when we do.
    with subprocess.Popen(_MAKING, stdin=subprocess.PIPE) as making:
        making.wait()


class Swift:
    """Loads the machine code in the background, and has it made where it has not been yet.

    Without the extra `fleet` there is none, and vehicles fly as plain Python: the same flight.
    """

    def __init__(self) -> None:
        self._machine: Machine | None = None
        self._asking = threading.Lock()

    def ask(self) -> None:
        """Begin, unless somebody has; safe to call from any thread."""
        if self._asking.acquire(blocking=False):
            threading.Thread(target=self._fetch, name="swift", daemon=True).start()

    def single(self) -> "Single | None":
        """What flies one vehicle; None while there is nothing yet."""
        return self._machine.single() if self._machine else None

    def _fetch(self) -> None:
        # Loaded here, in the background: one vehicle in real time needs none of it.
        from importlib.util import find_spec

        if find_spec("numba") is None:
            return
        from services.dynamics.process.machine import Machine, stored

        code = stored()
        if code is None:
            _log.info("compiling the vehicle, once for this machine; it flies meanwhile")
            have_made()
            code = stored()
        if code is None:
            _log.warning("the vehicle could not be compiled: it flies on as plain Python")
            return
        self._machine = Machine(code)
        _log.info("the vehicle flies compiled")
