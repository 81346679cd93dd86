"""A session's contact with the hub."""

import time
from typing import TypeVar

import zenoh

from services.runtime.bus.breaks import Breaks
from services.runtime.errors import QuadctlError, Unreachable
from services.runtime.realm import Realm

T = TypeVar("T")

_LOSING = 0.05
"""Seconds in which it is known that a connection is lost, at most."""


class Contact:
    """Whether the hub is there, and whether it is the one that was there at first."""

    def __init__(self, session: zenoh.Session, realm: Realm | None) -> None:
        """`realm` is the hub's, where it is one of this machine."""
        self._session, self._realm = session, realm
        self._since, self._first = time.time(), self._hubs()
        self._breaks: Breaks | None = None

    def watch(self) -> None:
        """From now on see that the connection is lost, though it come back; for who sends."""
        self._breaks = self._breaks or Breaks(self._session)

    @property
    def is_there(self) -> bool:
        """Whether the session is connected."""
        return bool(self._session.info.routers_zid())

    def answered(self, found: list[T]) -> list[T]:
        """What the hub has answered; raises Unreachable or TimedOut where it was nobody's answer."""
        # Without a connection there is nobody to ask, and the answer is what we have ourselves, or
        # empty at once. Of one that is being lost it is so a moment before that is known.
        deadline = time.monotonic() + _LOSING
        while self.is_there:
            if found or time.monotonic() > deadline:
                return found
            time.sleep(_LOSING / 10)
        raise self._lost()

    def check_unbroken(self) -> None:
        """Raise Unreachable where a part of what was sent may be lost, though all is well again.

        A session comes back by itself: to another hub, which has nothing of what the first was sent,
        or to the same one, from which it was cut off.
        """
        if not self._first & self._hubs():
            raise self._lost()
        if self._breaks and self._breaks.any():
            raise Unreachable(
                "the connection to the hub was lost for a moment: what was sent then has not come",
                "send it again; the hub was busy or frozen for longer than a second",
            )

    def _hubs(self) -> set[str]:
        return {str(hub) for hub in self._session.info.routers_zid()}

    def _lost(self) -> QuadctlError:
        from services.runtime.bus import missing

        return missing.hub_lost(self._realm, self._since)
