"""The caller's side of a service."""

import os
import threading
import time
from typing import Any, Generic, TypeVar

import zenoh
from msgspec import Struct

from schemas.contract import Service
from schemas.envelope import Call
from services.runtime import wire
from services.runtime.errors import Invalid, QuadctlError, TimedOut, Unreachable

Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)


class Caller(Generic[Q, R]):
    """Calls one service, as often as wanted."""

    def __init__(self, session: zenoh.Session, vehicle: str, service: Service[Q, R]) -> None:
        self._service, self._session = service, session
        self._key = service.key(vehicle)
        self._querier = session.declare_querier(
            self._key,
            target=zenoh.QueryTarget.BEST_MATCHING,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
        self._encoding = wire.encoding(service.request)

    def call(self, request: Q, timeout: float) -> R:
        """Send one request and return its reply.

        Waits for a server up to the timeout (s). Raises Unreachable, TimedOut, or what the
        server replied. The request carries an id and the deadline: it is executed once or
        never, and never late.
        """
        try:
            payload = wire.encode(request)
        except (OverflowError, TypeError) as error:
            raise Invalid(f"the request cannot be sent: {error}") from error
        deadline = time.monotonic() + timeout
        self._wait_for_server(deadline, timeout)
        left = max(deadline - time.monotonic(), 0.001)
        ticket = Call(id=os.urandom(8).hex(), deadline=time.time() + left)
        replies = self._session.get(
            self._key,
            payload=payload,
            encoding=self._encoding,
            attachment=wire.encode(ticket),
            target=zenoh.QueryTarget.BEST_MATCHING,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=left,
        )
        for reply in replies:
            return self._read(reply, timeout)
        raise Unreachable(
            f"the server of {self._key} went away in mid-call: the outcome is unknown",
            "look at `quadctl status`, then ask again",
        )

    def _read(self, reply: zenoh.Reply, timeout: float) -> R:
        if reply.ok is not None:
            payload, said = reply.ok.payload.to_bytes(), str(reply.ok.encoding)
            return wire.decode(self._service.response, payload, said)
        assert reply.err is not None  # noqa: S101 - Zenoh's promise: one of the two is set
        if str(reply.err.encoding) == wire.ERROR_ENCODING:
            raise wire.decode_error(reply.err.payload.to_bytes())
        text = reply.err.payload.to_string()
        if text == "Timeout":
            raise TimedOut(
                f"{self._key} did not answer within {timeout:g} s",
                "its process is busy or frozen: `quadctl status` shows which",
            )
        raise QuadctlError(f"{self._key} failed: {text}")

    def _served(self) -> bool:
        status: Any = self._querier.matching_status  # the stubs take it for a bool
        return bool(status.matching)

    def _wait_for_server(self, deadline: float, timeout: float) -> None:
        if self._served():
            return
        arrived = threading.Event()

        def on_change(status: zenoh.MatchingStatus) -> None:
            if status.matching:
                arrived.set()

        listener = self._querier.declare_matching_listener(
            zenoh.handlers.Callback(on_change, indirect=False)
        )
        try:
            if self._served():
                return
            if not arrived.wait(max(deadline - time.monotonic(), 0)):
                raise Unreachable(
                    f"nobody served {self._key} within {timeout:g} s",
                    "its process is down or does not offer it, or this identity may not call it:"
                    " `quadctl status`, `quadctl service list`",
                )
        finally:
            listener.undeclare()
