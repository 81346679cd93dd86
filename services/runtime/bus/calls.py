"""Client side of a service: calls with decoded or raw payloads."""

import os
import time
from typing import Generic, TypeVar

import zenoh
from msgspec import Struct

from quadctl.schemas.services import Call
from quadctl.schemas.topics import Service
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.codec import to_jsonable
from quadctl.services.runtime.bus.session import unless_closed
from quadctl.services.runtime.bus.zenoh_events import ONE_SERVER, MatchingListener
from quadctl.services.runtime.errors import Invalid, QuadctlError, TimedOut, Unreachable

_LOST = 0.1
"""Seconds within which the hub reports the end of a server that gave no answer."""

Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)


class ServiceClient(Generic[Q, R]):
    """Client of one service, for any number of calls."""

    def __init__(self, session: zenoh.Session, vehicle: str, service: Service[Q, R]) -> None:
        self._service = service
        self._client = RawServiceClient(session, service.key(vehicle))
        self._encoding = codec.encoding(service.request)

    def call(self, request: Q, timeout: float, boot: str = "", *, again: bool = False) -> R:
        """Send one request and return its reply; wait and raise as RawServiceClient does."""
        try:
            payload = codec.encode(request)
        except (OverflowError, TypeError, UnicodeEncodeError, RecursionError) as error:
            hint = "give plain numbers, texts, lists and tables"
            raise Invalid(f"the request cannot be sent: {error}", hint) from error
        answer = self._client.call(payload, self._encoding, timeout, boot, again=again)
        return codec.decode(self._service.response, *answer)


class RawServiceClient:
    """Client that sends bytes to the server of a key."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._session, self._key = session, key
        with unless_closed(session):
            self._querier = session.declare_querier(self._key, **ONE_SERVER)
        self._server = MatchingListener(self._querier)

    def call(
        self, payload: bytes, encoding: str, timeout: float, boot: str = "", *, again: bool = False
    ) -> tuple[bytes, str]:
        """Send one request; return the reply and its encoding.

        Waits for a server up to the timeout (s). Raises Unreachable, TimedOut or the server's
        error. The request carries an id and the deadline: it is executed once or never, and never
        late. `again` repeats a request that may get lost between routers that have just met; only
        for a server that checks the id.
        """
        with unless_closed(self._session):
            return self._call(payload, encoding, timeout, boot, again=again)

    def _call(
        self, payload: bytes, encoding: str, timeout: float, boot: str, *, again: bool
    ) -> tuple[bytes, str]:
        deadline = time.monotonic() + timeout
        self.wait_for_server(timeout)
        changes = self._server.changes if again else 0
        left = max(deadline - time.monotonic(), 0.001)
        ticket = codec.encode(Call(id=os.urandom(8).hex(), deadline=time.time() + left, boot=boot))
        while left > 0:
            replies = self._session.get(
                self._key,
                payload=payload,
                encoding=encoding,
                attachment=ticket,
                timeout=left,
                **ONE_SERVER,
            )
            for reply in replies:
                return read(reply, self._key, timeout)
            if not again:
                break
            time.sleep(max(min(_LOST, deadline - time.monotonic()), 0))
            # Another server does not know the id and might execute the request a second time.
            if self._server.changes != changes:
                break
            left = deadline - time.monotonic()
        # The hub reports the end of a server a moment later.
        time.sleep(max(min(_LOST, deadline - time.monotonic()), 0))
        raise gone(self._key, still_there=self._server.is_there)

    def wait_for_server(self, timeout: float) -> None:
        """Wait until a server is there; raise Unreachable if none comes in time (s)."""
        if not self._server.wait(timeout):
            raise Unreachable(
                f"nobody served {self._key} within {round(timeout, 2):g} s",
                "its process is down or does not offer it, or this identity may not call it:"
                " `quadctl status`, `quadctl service list`",
            )


def read(reply: zenoh.Reply, key: str, timeout: float) -> tuple[bytes, str]:
    """Return a reply and its encoding; raise the exception of an error reply."""
    # The binding makes a copy of each part at every access.
    if (ok := reply.ok) is not None:
        return ok.payload.to_bytes(), str(ok.encoding)
    err = reply.err
    assert err is not None  # noqa: S101 - Zenoh's promise: one of the two is set
    payload, encoding = err.payload.to_bytes(), str(err.encoding)
    if encoding == codec.ERROR_ENCODING:
        raise codec.decode_error(payload)
    if payload == b"Timeout":
        raise TimedOut(
            f"{key} did not answer within {round(timeout, 2):g} s",
            "its process is busy or frozen: `quadctl status` shows which",
        )
    raise QuadctlError(f"{key} failed: {to_jsonable(payload, encoding)}", "see the log of its node")


def gone(key: str, *, still_there: bool = False) -> Unreachable:
    """Return the error for a call that ended without an answer; is its server `still_there`?"""
    if still_there:
        return Unreachable(
            f"the server of {key} ended the call without an answer: the outcome is unknown",
            "its handler may have failed: see the log of its process",
        )
    return Unreachable(
        f"the server of {key} ended during the call: the outcome is unknown",
        "check `quadctl status`, then call again",
    )
