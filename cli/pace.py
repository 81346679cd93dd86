"""Waiting between messages that are sent, and noticing meanwhile that the hub is gone."""

import time

from services.runtime.bus.client import Client


class Pace:
    """What is sent to a hub that is gone is lost, and nobody else would say so: so it is asked.

    Twice within the client's timeout, so that its loss is told by then, however long a rest is.
    """

    def __init__(self, client: Client) -> None:
        """It counts from now."""
        self._client, self._asked = client, time.monotonic()

    def rest(self, until: float) -> None:
        """Sleep until a time (monotonic s); raises what `ask` does, as soon as it is due."""
        half = self._client.timeout / 2
        while (now := time.monotonic()) < until or now > self._asked + half:
            time.sleep(max(min(until, self._asked + half) - now, 0))
            if time.monotonic() > self._asked + half:
                self.ask()

    def ask(self) -> None:
        """Hear of the hub that it has all that was sent; raises as Client.flush."""
        # What is left of the timeout since it was asked last; if we were late ourselves, half of it.
        left = self._asked + self._client.timeout - time.monotonic()
        self._client.flush(max(left, self._client.timeout / 2))
        self._asked = time.monotonic()
