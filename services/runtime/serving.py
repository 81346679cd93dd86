"""The server's side of a service: every query that arrives is answered, none twice executed."""

import logging
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

import zenoh
from msgspec import Struct

from schemas.contract import Service
from services.runtime import wire
from services.runtime.errors import Expired, Invalid, QuadctlError

Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)

_REMEMBERED = 1024
"""How many calls' replies are kept, so that a repeated id is answered and not executed."""

_log = logging.getLogger(__name__)

Answer = tuple[bool, bytes]
"""Whether it is a reply or an error reply, and its payload."""


class Server(Generic[Q, R]):
    """Turns the queries of one service into calls of a handler.

    `answer` runs on the node's loop. The handler may raise a QuadctlError to refuse.
    """

    def __init__(self, vehicle: str, service: Service[Q, R], handler: Callable[[Q], R]) -> None:
        self.key = service.key(vehicle)
        self._service, self._handler = service, handler
        self._encoding = wire.encoding(service.response)
        self._answers: OrderedDict[str, Answer] = OrderedDict()

    def answer(self, query: zenoh.Query) -> None:
        """Reply to one query, come what may."""
        with query:
            ok, payload = self._answer(query)
            if ok:
                query.reply(self.key, payload, encoding=self._encoding)
            else:
                query.reply_err(payload, encoding=wire.ERROR_ENCODING)

    def _answer(self, query: zenoh.Query) -> Answer:
        try:
            if str(query.key_expr) != self.key:
                raise Invalid(
                    f"'{query.key_expr}' is a pattern, and services are not called by pattern",
                    f"call {self.key}",
                )
            call = wire.decode_call(query.attachment.to_bytes() if query.attachment else None)
            if call is None:
                return self._execute(query)
            if call.id not in self._answers:
                if call.deadline < time.time():
                    raise Expired("the call came after its deadline and was not executed")
                self._remember(call.id, self._execute(query))
            return self._answers[call.id]
        except QuadctlError as error:
            return False, wire.encode_error(error)

    def _execute(self, query: zenoh.Query) -> Answer:
        try:
            payload = query.payload.to_bytes() if query.payload is not None else b""
            said = str(query.encoding) if query.encoding is not None else ""
            return True, wire.encode(
                self._handler(wire.decode(self._service.request, payload, said))
            )
        except QuadctlError as error:
            return False, wire.encode_error(error)
        except Exception:  # noqa: BLE001 - whatever a handler does wrong is answered
            # A fault in a handler must not end the process, nor leave its caller waiting.
            _log.exception("%s failed", self.key)
            return False, wire.encode_error(
                QuadctlError(f"{self.key} failed inside", "its log has the traceback")
            )

    def _remember(self, call_id: str, answer: Answer) -> None:
        self._answers[call_id] = answer
        if len(self._answers) > _REMEMBERED:
            self._answers.popitem(last=False)
