"""The server's side of a service: every query that arrives is answered, none executed twice."""

import logging
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

import zenoh
from msgspec import Struct

from schemas.contract import Service
from schemas.envelope import Call
from services.runtime.bus import wire
from services.runtime.errors import Expired, Invalid, QuadctlError
from services.runtime.journal import Journal
from services.runtime.schedule import Held, Schedule

Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)

_REMEMBERED = 1024
"""How many calls' replies are kept, so that a repeated id is answered and not executed."""

_log = logging.getLogger(__name__)

Answer = tuple[bool, bytes]
"""Whether it is a reply or an error reply, and its payload."""


class Server(Generic[Q, R]):
    """Turns the queries of one service into calls of a handler.

    `answer` runs on the node's loop. The handler may raise a QuadctlError to refuse. A call for a
    simulated time waits in `schedule` and is answered when that has come. `journal` is told of all
    that is executed.
    """

    def __init__(
        self,
        vehicle: str,
        service: Service[Q, R],
        handler: Callable[[Q], R],
        schedule: Schedule | None = None,
        journal: Journal | None = None,
    ) -> None:
        self.key = service.key(vehicle)
        self.call: Call | None = None
        """What goes with the request that is being executed, where anything does."""
        self._service, self._handler = service, handler
        self._schedule, self._journal = schedule or Schedule(), journal
        self._encoding = wire.encoding(service.response)
        self._answers: OrderedDict[str, Answer] = OrderedDict()
        self._held: dict[str, list[zenoh.Query]] = {}

    def answer(self, query: zenoh.Query) -> None:
        """Reply to one query, come what may: now, or when its simulated time has come."""
        try:
            call = self._call(query)
            answer = self._execute(query, None) if call is None else self._once(call, query)
        except QuadctlError as error:
            answer = False, wire.encode_error(error)
        if answer is not None:
            self._reply(query, answer)

    def _call(self, query: zenoh.Query) -> Call | None:
        if str(query.key_expr) != self.key:
            raise Invalid(
                f"'{query.key_expr}' is a pattern, and services are not called by pattern",
                f"call {self.key}",
            )
        # The binding makes each part anew whenever it is looked at.
        attachment = query.attachment
        return wire.decode_call(attachment.to_bytes() if attachment else None)

    def _once(self, call: Call, query: zenoh.Query) -> Answer | None:
        """The first answer to this call, None where it is yet to be given."""
        if call.id in self._held:
            self._held[call.id].append(query)
            return None
        if call.id not in self._answers:
            if call.deadline < time.time():
                raise Expired("the call came after its deadline and was not executed")
            if call.at is not None:
                self._hold(call, call.at, query)
                return None
            self._remember(call.id, self._execute(query, call))
        return self._answers[call.id]

    def _hold(self, call: Call, at: float, query: zenoh.Query) -> None:
        def settle(problem: QuadctlError | None) -> None:
            answer = (False, wire.encode_error(problem)) if problem else self._execute(query, call)
            self._remember(call.id, answer)
            for waiting in self._held.pop(call.id):
                self._reply(waiting, answer)

        self._schedule.hold(Held(call.boot, at, call.deadline, settle))
        self._held[call.id] = [query]

    def _reply(self, query: zenoh.Query, answer: Answer) -> None:
        ok, payload = answer
        with query:
            if ok:
                query.reply(self.key, payload, encoding=self._encoding)
            else:
                query.reply_err(payload, encoding=wire.ERROR_ENCODING)

    def _execute(self, query: zenoh.Query, call: Call | None) -> Answer:
        self.call = call
        try:
            sent, encoding = query.payload, query.encoding
            payload = sent.to_bytes() if sent is not None else b""
            said = str(encoding) if encoding is not None else ""
            request = wire.decode(self._service.request, payload, said)
        except QuadctlError as error:
            return False, wire.encode_error(error)
        answer = self._handle(request)
        if self._journal is not None:
            self._journal.tell(request, answer, held=call is not None and call.at is not None)
        return answer

    def _handle(self, request: Q) -> Answer:
        try:
            return True, wire.encode(self._handler(request))
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
