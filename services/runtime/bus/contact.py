"""A session's contact with the hub."""

import time
from typing import TypeVar

import zenoh

from services.runtime.errors import QuadctlError
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
        """Raise Unreachable where another hub is there now: it has nothing of what the first was sent.

        A session comes back by itself.
        """
        if not self._first & self._hubs():
            raise self._lost()

    def _hubs(self) -> set[str]:
        return {str(hub) for hub in self._session.info.routers_zid()}

    def _lost(self) -> QuadctlError:
        from services.runtime.bus import missing

        return missing.hub_lost(self._realm, self._since)
