"""A survey of the bus on a thread of its own, while the rest is looked at."""

import threading
import time

from services.runtime.bus.session import Address
from services.runtime.bus.survey import Survey, survey
from services.runtime.errors import QuadctlError, TimedOut

_MARGIN = 0.1
"""Seconds of the timeout kept for what comes after: judging and printing."""


class Watch:
    """A survey under way; ends by its timeout (s), come what may. Without an address, none."""

    def __init__(self, address: Address | None, vehicle: str, timeout: float) -> None:
        self._found: Survey | BaseException | None = None
        timeout = max(timeout - _MARGIN, _MARGIN)
        self._deadline = time.monotonic() + timeout
        self._thread: threading.Thread | None = None
        if address is not None:
            self._thread = threading.Thread(
                target=self._look, args=(address, vehicle, timeout), daemon=True
            )
            self._thread.start()

    def result(self) -> Survey | QuadctlError | None:
        """What was found, or why nothing could be; None where nothing was looked for."""
        if self._thread is None:
            return None
        self._thread.join(max(self._deadline - time.monotonic(), 0) + _MARGIN)
        if self._thread.is_alive():
            return TimedOut("the hub takes connections and does not answer")
        if isinstance(self._found, BaseException) and not isinstance(self._found, QuadctlError):
            raise self._found
        return self._found

    def _look(self, address: Address, vehicle: str, timeout: float) -> None:
        try:
            self._found = survey(address, vehicle, timeout)
        except BaseException as error:  # noqa: BLE001 - told to who asks for the result
            self._found = error
