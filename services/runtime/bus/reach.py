"""The way to a realm's hub."""

import contextlib
import time

import zenoh

from services.runtime.bus.session import Address, address_of, open_client
from services.runtime.errors import NotAllowed, TimedOut, Unreachable
from services.runtime.realm import Realm
from services.runtime.record import is_live, not_running
from services.runtime.secure.endpoints import check, how_to_open, is_secure

_REOPENING = 1.0
"""Seconds in which a gate is back that lets everybody in anew; it takes half of it."""
_POLL = 0.05


def reach(realm: Realm, connect: str, timeout: float) -> zenoh.Session:
    """Connect at once, or fail at once; only a hub or gate that is just being restarted is waited for.

    `connect` is an endpoint in place of the realm's own, or empty. Raises Unreachable when no hub is
    there, TimedOut when it does not answer in time (s), UsageError for what is no endpoint.
    """
    if connect:
        check(connect)
    if is_secure(connect):
        return _through_gate(Address(connect), timeout)
    address, began = address_of(realm, connect), time.monotonic()
    silent = f"the realm {realm.name} is up, but its hub did not answer within {timeout:g} s"
    try:
        return open_client(address, timeout=timeout)
    except TimedOut as problem:
        if connect:
            raise
        raise TimedOut(
            silent,
            "its process is frozen or busy: it is restarted by itself, or with"
            " `quadctl node restart hub`",
        ) from problem
    except Unreachable as problem:
        if connect:
            raise Unreachable(problem.message, how_to_open(connect)) from problem
        if not is_live(realm):
            raise not_running(realm) from None
        left = timeout - (time.monotonic() - began)
        if left > 0:
            with contextlib.suppress(Unreachable):
                return open_client(address, wait=left, timeout=left)
        raise Unreachable(
            silent,
            "it is restarted by itself; where that does not help: `quadctl down`, `quadctl up`",
        ) from None


def _through_gate(address: Address, timeout: float) -> zenoh.Session:
    # A gate opens anew for a new list of names, which may be the one that has ours: who was not let
    # in, or came to it before, comes again.
    from services.runtime.secure import permit

    began = seen = time.monotonic()
    while True:
        try:
            session = open_client(address, timeout=timeout)
        except NotAllowed:
            raise
        except Unreachable:
            if time.monotonic() > seen + min(timeout, _REOPENING):
                raise
        else:
            while not (let_in := permit.is_let_in(session, timeout)) and session.info.routers_zid():
                if time.monotonic() > began + min(timeout, permit.IN_FORCE):
                    raise permit.kept_out(address.endpoint)
                time.sleep(_POLL)
            if let_in:
                return session
            seen = time.monotonic()
        time.sleep(_POLL)
