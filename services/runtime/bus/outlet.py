"""A command's sending end of any key."""

import zenoh

from services.runtime.bus.matching import Matching


class Outlet:
    """Publishes bytes on a key, for as long as its client's `with` block lasts."""

    def __init__(self, session: zenoh.Session, key: str, encoding: str) -> None:
        # A message that somebody typed waits for room; at a robot's rates the next would do.
        self._publisher = session.declare_publisher(
            key,
            encoding=encoding or zenoh.Encoding.ZENOH_BYTES,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        self._listeners = Matching(self._publisher)

    def put(self, payload: bytes) -> None:
        """Publish one message."""
        self._publisher.put(payload)

    def wait_for_listener(self, timeout: float) -> bool:
        """Wait up to a timeout (s) for somebody who listens; False where nobody came."""
        return self._listeners.wait(timeout)

    def is_heard(self) -> bool:
        """Whether anybody listens, as far as the hub has said; ask after a round trip to it."""
        return self._listeners.is_there
