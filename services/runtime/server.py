"""Server side of a service: dispatch, exactly-once, scheduled calls, call log.

The clock is a boot of the simulation and a time in it. A call is for the present boot or a future
one; it is never executed once its boot is over.
"""

import logging
import time
from collections import OrderedDict
from collections.abc import Callable
from math import inf
from typing import Any, Generic, NamedTuple, TypeVar

import msgspec
import zenoh
from msgspec import Struct

from quadctl.schemas.messages import Called
from quadctl.schemas.services import Call
from quadctl.schemas.topics import Service, called
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.pubsub import Publisher
from quadctl.services.runtime.errors import Expired, Invalid, NotReady, QuadctlError, Refused

MOST = 10_000
"""Calls that a node holds at a time."""


class ScheduledCall(NamedTuple):
    """A call that waits.

    `at` is in simulated s of `boot`, `deadline` in Unix s. `settle` is called once: with None to
    execute and answer it, else with the reason why it will not be.
    """

    boot: str
    at: float
    deadline: float
    settle: Callable[[QuadctlError | None], None]


class Schedule:
    """The calls that one node holds, and the simulated time that it has seen."""

    def __init__(self) -> None:
        self._boot, self._stamp = "", 0.0
        self._held: list[ScheduledCall] = []
        self._soonest = self._first_deadline = inf
        self.under_way = False
        """Whether a call waits for a time of the boot that is now."""
        self.holding = False
        """Whether any call waits."""

    @property
    def now(self) -> tuple[str, float]:
        """The boot and the time in it (simulated s) last seen; "" and 0 before the first."""
        return self._boot, self._stamp

    def schedule(self, call: ScheduledCall) -> None:
        """Let a call wait; one for boot "" is for the boot that is now.

        Raises NotReady, Expired or Refused where it cannot.
        """
        if not self._boot:
            raise NotReady(
                "no simulated time is known here",
                "is dynamics up? `quadctl status`; a node of your own calls `node.advance_sim_time`",
            )
        call = call._replace(boot=call.boot or self._boot)
        if call.boot == self._boot and call.at <= self._stamp:
            raise Expired(f"the call was for {call.at:g} s, and it is {self._stamp:g} s already")
        if len(self._held) >= MOST:
            raise Refused(f"{MOST} calls are held already", "let some of them be executed first")
        self._keep([*self._held, call])

    def advance(self, boot: str, stamp: float, now: float) -> None:
        """It is `stamp` of `boot`, and `now` by Unix time: settle the calls whose time has come.

        They are settled in the order of their times, equal ones in the order of their arrival.
        """
        before, self._boot, self._stamp = self._boot, boot, stamp
        # Told of every pose, and nearly always there is nothing to do.
        if boot == before and stamp < self._soonest and now <= self._first_deadline:
            return
        due: list[ScheduledCall] = []
        late: list[tuple[ScheduledCall, str]] = []
        rest: list[ScheduledCall] = []
        for call in self._held:
            if call.boot == before != boot:
                late.append((call, f"the call was for {call.at:g} s of a boot that is over"))
            elif call.deadline < now:
                late.append((call, "the deadline passed before the call's simulated time came"))
            elif call.boot == boot and call.at <= stamp:
                due.append(call)
            else:
                rest.append(call)
        self._keep(rest)
        for call, why in late:
            call.settle(Expired(why))
        for call in sorted(due, key=lambda call: call.at):
            call.settle(None)

    def _keep(self, calls: list[ScheduledCall]) -> None:
        self._held, self.holding = calls, bool(calls)
        ours = [call.at for call in calls if call.boot == self._boot]
        self.under_way = bool(ours)
        self._soonest = min(ours, default=inf)
        self._first_deadline = min((call.deadline for call in calls), default=inf)


_LONGEST = 1_000
"""Characters of an error that are told."""


class CallLog:
    """Publishes each call on `VEHICLE/@call/SERVICE`, with the time that the schedule shows."""

    def __init__(
        self, session: zenoh.Session, vehicle: str, service: Service[Any, Any], schedule: Schedule
    ) -> None:
        topic = called(service)
        self._service, self._schedule = service, schedule
        self._calls = Publisher(session, topic.key(vehicle), topic)

    def publish(self, request: Struct, answer: tuple[bool, bytes], *, held: bool) -> None:
        """Tell of a request, and of the reply or error reply that it got, where anybody listens."""
        if not self._calls.is_heard:
            return
        boot, stamp = self._schedule.now
        ok, payload = answer
        self._calls.put(
            Called(
                boot,
                stamp,
                self._service.name,
                held,
                msgspec.to_builtins(request),
                msgspec.msgpack.decode(payload) if ok else {},
                "" if ok else codec.decode_error(payload).message[:_LONGEST],
            )
        )


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
        journal: CallLog | None = None,
    ) -> None:
        self.key = service.key(vehicle)
        self.call: Call | None = None
        """What goes with the request that is being executed, where anything does."""
        self._service, self._handler = service, handler
        self._schedule, self._journal = schedule or Schedule(), journal
        self._encoding = codec.encoding(service.response)
        self._answers: OrderedDict[str, Answer] = OrderedDict()
        self._held: dict[str, list[zenoh.Query]] = {}

    def answer(self, query: zenoh.Query) -> None:
        """Reply to one query, come what may: now, or when its simulated time has come."""
        try:
            call = self._call(query)
            answer = self._execute(query, None) if call is None else self._once(call, query)
        except QuadctlError as error:
            answer = False, codec.encode_error(error)
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
        return codec.decode_call(attachment.to_bytes() if attachment else None)

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
            answer = (False, codec.encode_error(problem)) if problem else self._execute(query, call)
            self._remember(call.id, answer)
            for waiting in self._held.pop(call.id):
                self._reply(waiting, answer)

        self._schedule.schedule(ScheduledCall(call.boot, at, call.deadline, settle))
        self._held[call.id] = [query]

    def _reply(self, query: zenoh.Query, answer: Answer) -> None:
        ok, payload = answer
        with query:
            if ok:
                query.reply(self.key, payload, encoding=self._encoding)
            else:
                query.reply_err(payload, encoding=codec.ERROR_ENCODING)

    def _execute(self, query: zenoh.Query, call: Call | None) -> Answer:
        self.call = call
        try:
            sent, encoding = query.payload, query.encoding
            payload = sent.to_bytes() if sent is not None else b""
            said = str(encoding) if encoding is not None else ""
            request = codec.decode(self._service.request, payload, said)
        except QuadctlError as error:
            return False, codec.encode_error(error)
        answer = self._handle(request)
        if self._journal is not None:
            self._journal.publish(request, answer, held=call is not None and call.at is not None)
        return answer

    def _handle(self, request: Q) -> Answer:
        try:
            return True, codec.encode(self._handler(request))
        except QuadctlError as error:
            return False, codec.encode_error(error)
        except Exception:  # noqa: BLE001 - whatever a handler does wrong is answered
            # A fault in a handler must not end the process, nor leave its caller waiting.
            _log.exception("%s failed", self.key)
            return False, codec.encode_error(
                QuadctlError(f"{self.key} failed inside", "its log has the traceback")
            )

    def _remember(self, call_id: str, answer: Answer) -> None:
        self._answers[call_id] = answer
        if len(self._answers) > _REMEMBERED:
            self._answers.popitem(last=False)
