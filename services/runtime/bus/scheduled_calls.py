"""Calls for a later simulated time: sent now, executed and answered then."""

import os
import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import zenoh
from msgspec import Struct

from quadctl.schemas.services import Call
from quadctl.schemas.topics import Service
from quadctl.services.runtime.bus import calls, codec, zenoh_events
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import QuadctlError

Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)


class FutureCall(Generic[Q, R]):
    """Call for a time (simulated s) of a boot, which may not have begun.

    Later one of `reply` and `problem` is set: the server's answer, or why there is none. Then
    `settled` is called, on a Zenoh thread. After `patience` (s) the call is no longer executed.
    """

    def __init__(
        self,
        client: Client,
        service: Service[Q, R],
        request: Q,
        *,
        boot: str,
        at: float,
        patience: float,
        settled: Callable[[], None],
    ) -> None:
        self.reply: R | None = None
        self.problem: QuadctlError | None = None
        self._key, self._service = service.key(client.vehicle), service
        self._patience = patience
        client.permit("call", self._key)
        self._settled = settled
        ticket = Call(os.urandom(8).hex(), time.time() + patience, at, boot)
        callback: Any = zenoh.handlers.Callback(self._on_reply, self._on_end, indirect=False)
        client.session.get(
            self._key,
            callback,
            payload=codec.encode(request),
            encoding=codec.encoding(service.request),
            attachment=codec.encode(ticket),
            timeout=patience,
            **zenoh_events.ONE_SERVER,
        )

    def _on_reply(self, reply: zenoh.Reply) -> None:
        zenoh_events.pin_thread_state()
        try:
            answer = calls.read(reply, self._key, self._patience)
            self.reply = codec.decode(self._service.response, *answer)
        except QuadctlError as problem:
            self.problem = problem
        self._settled()

    def _on_end(self) -> None:
        if self.reply is None and self.problem is None:
            self.problem = calls.gone(self._key)
            self._settled()
