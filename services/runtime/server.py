"""Server side of a service: dispatch, exactly-once, scheduled calls, call log.

Time is a boot of the simulation and the simulated time in it. A call is for the current boot or a
later one; it is never executed after its boot has ended.
"""

import itertools
import logging
import time
from collections import Counter, OrderedDict
from collections.abc import Callable
from functools import partial
from heapq import heapify, heappop, heappush
from typing import Any, Generic, NamedTuple, TypeVar

import msgspec
import zenoh
from msgspec import Struct

from quadctl.schemas.messages import Called
from quadctl.schemas.services import Call
from quadctl.schemas.topics import SETPOINT, Service, called
from quadctl.services.runtime.bus import codec, zenoh_events
from quadctl.services.runtime.errors import Expired, Invalid, NotReady, QuadctlError, Refused
from quadctl.services.runtime.executor import Executor

MOST = 5_000
"""Most calls of a service that wait: those of the longest mission, which are sent all at once."""
_AT_ONCE = 100
"""Most scheduled calls of a service for one period of the setpoint: they are executed at one pose,
and the other vehicles of a process wait for them, some 20 ms."""
_SPARE = 64
_REPEATS = 8
"""Most queries of one call that wait."""


class ScheduledCall(NamedTuple):
    """Call that waits for its simulated time.

    `at` is in simulated s of `boot`, `deadline` in monotonic s. `settle` is called once: with None to
    execute and answer the call, else with the error that answers it.
    """

    boot: str
    at: float
    deadline: float
    settle: Callable[[QuadctlError | None], None]


class Schedule:
    """Scheduled calls of one node, and the simulated time that it last received.

    Only a run in lock-step takes any: in real time, the order of a call and a pose is chance.
    """

    def __init__(self, *, lockstep: bool) -> None:
        self._lockstep = lockstep
        self._boot, self._stamp = "", 0.0
        self._ended: set[str] = set()
        self._numbers = itertools.count()
        self._waiting: dict[int, ScheduledCall] = {}
        # Heaps with the numbers of calls; that of a settled one stays until it comes up.
        self._times: list[tuple[float, int]] = []  # of the current boot
        self._deadlines: list[tuple[float, int]] = []

    @property
    def holding(self) -> bool:
        """Return whether any call waits."""
        return bool(self._waiting)

    @property
    def now(self) -> tuple[str, float]:
        """Return the boot and the time in it (simulated s) last received; "" and 0 before."""
        return self._boot, self._stamp

    def schedule(self, call: ScheduledCall) -> None:
        """Add a call; boot "" is the current one. Raises Refused, NotReady or Expired."""
        if not self._lockstep:
            raise Refused(
                "this run is in real time, and executes no call at a simulated time",
                "`quadctl up --set dynamics.lockstep=true` does; `quadctl fly FILE` flies a mission"
                " in a run of its own",
            )
        if not self._boot:
            raise NotReady(
                "this node has received no simulated time yet",
                "is dynamics up? `quadctl status`; your own node ends with a loop over `node.poses()` or"
                " `node.ticks()`, or with `node.spin()`",
            )
        call = call._replace(boot=call.boot or self._boot)
        if call.boot == self._boot and call.at <= self._stamp:
            raise Expired(f"the call was for {call.at:g} s, and it is {self._stamp:g} s now")
        number = next(self._numbers)
        self._waiting[number] = call
        if call.boot == self._boot:
            heappush(self._times, (call.at, number))
        heappush(self._deadlines, (call.deadline, number))
        if len(self._times) + len(self._deadlines) > 4 * len(self._waiting) + _SPARE:
            self._forget_settled()

    def advance(
        self, boot: str, stamp: float, now: float, first: Callable[[], None] | None = None
    ) -> None:
        """Set the time to `stamp` of `boot`, `now` in monotonic s, and settle the calls that are due.

        They are settled in the order of their times, equal ones in the order of their arrival; if there
        are any, `first` is called before. A time before that of the last call changes nothing: a node's
        own loop may be behind.
        """
        if boot in self._ended or (boot == self._boot and stamp < self._stamp):
            return
        before, self._boot, self._stamp = self._boot, boot, stamp
        if boot != before:
            self._ended.add(before)
        if not self._waiting:
            return
        late: list[tuple[ScheduledCall, str]] = []
        if boot != before:
            ended = [number for number, call in self._waiting.items() if call.boot == before]
            late = [
                (call, f"the call was for {call.at:g} s of a boot that has ended")
                for call in map(self._waiting.pop, ended)
            ]
            self._forget_settled()
        late += [
            (call, "the deadline passed before the call's simulated time came")
            for call in self._taken(self._deadlines, lambda deadline: deadline < now)
        ]
        due = self._taken(self._times, lambda at: at <= stamp)
        for call, why in late:
            call.settle(Expired(why))
        if due and first:
            first()
        for call in due:
            call.settle(None)

    def _taken(
        self, heap: list[tuple[float, int]], ready: Callable[[float], bool]
    ) -> list[ScheduledCall]:
        """Take the calls at the top of a heap out, as long as they are ready."""
        taken = []
        while heap and ready(heap[0][0]):
            call = self._waiting.pop(heappop(heap)[1], None)
            if call is not None:
                taken.append(call)
        return taken

    def _forget_settled(self) -> None:
        """Make both heaps anew, for the current boot."""
        calls = self._waiting.items()
        self._times = [(call.at, number) for number, call in calls if call.boot == self._boot]
        self._deadlines = [(call.deadline, number) for number, call in calls]
        heapify(self._times)
        heapify(self._deadlines)


_LONGEST = 1_000
"""Most characters of an error that are published."""


class CallLog:
    """Publisher of each call on `VEHICLE/@call/SERVICE`, with the time of the schedule."""

    def __init__(
        self, session: zenoh.Session, vehicle: str, service: Service[Any, Any], schedule: Schedule
    ) -> None:
        topic = called(service)
        self._service, self._schedule = service, schedule
        # Without a declared publisher: a thousand vehicles have eight thousand services.
        self._put = partial(session.put, topic.key(vehicle), encoding=codec.encoding(topic.type))

    def publish(self, request: Struct, answer: tuple[bool, bytes], *, held: bool) -> None:
        """Publish a request and its reply or error reply."""
        boot, stamp = self._schedule.now
        ok, payload = answer
        call = Called(
            boot,
            stamp,
            self._service.name,
            held,
            msgspec.to_builtins(request),
            msgspec.msgpack.decode(payload) if ok else {},
            "" if ok else codec.decode_error(payload).message[:_LONGEST],
        )
        self._put(codec.encode(call))


Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)

_REMEMBERED = 1024
"""Most calls of which the reply is kept, so that a repeated id is answered and not executed."""

_log = logging.getLogger(__name__)

Answer = tuple[bool, bytes]
"""True for a reply and False for an error reply, and the payload."""


class Server(Generic[Q, R]):
    """Server of one service, which calls the handler for each query.

    `answer` runs on the node's loop. The handler may raise a QuadctlError to refuse. A call for a
    simulated time waits in `schedule` until then. `journal` publishes every executed call.
    """

    def __init__(
        self,
        vehicle: str,
        service: Service[Q, R],
        handler: Callable[[Q], R],
        schedule: Schedule,
        journal: CallLog | None = None,
    ) -> None:
        self.key = service.key(vehicle)
        self.call: Call | None = None
        """Id, deadline and time of the request in execution; None if it has none."""
        self._service, self._handler = service, handler
        self._schedule, self._journal = schedule, journal
        self._encoding = codec.encoding(service.response)
        self._answers: OrderedDict[str, Answer] = OrderedDict()
        self._held: dict[str, list[zenoh.Query]] = {}
        self._together: Counter[tuple[str, int]] = Counter()
        """Held calls by the boot and the period of the setpoint that they are for."""

    def answer(self, query: zenoh.Query) -> None:
        """Reply to one query in every case: now, or at its simulated time."""
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
        # The binding makes a copy of each part at every access.
        attachment = query.attachment
        return codec.decode_call(attachment.to_bytes() if attachment else None)

    def _once(self, call: Call, query: zenoh.Query) -> Answer | None:
        """Return the first answer to this call; None if it still waits."""
        if waiting := self._held.get(call.id):
            # A client asks again when its link was lost, so the older ones wait for nothing.
            del waiting[: 1 - _REPEATS]
            waiting.append(query)
            return None
        if call.id not in self._answers:
            if call.deadline < time.time():
                raise Expired("the call arrived after its deadline and was not executed")
            if call.at is not None:
                self._hold(call, call.at, query)
                return None
            self._remember(call.id, self._execute(query, call))
        return self._answers[call.id]

    def _hold(self, call: Call, at: float, query: zenoh.Query) -> None:
        period = call.boot, SETPOINT.period(at)

        def settle(problem: QuadctlError | None) -> None:
            self._together[period] -= 1
            if not self._together[period]:
                del self._together[period]
            answer = (False, codec.encode_error(problem)) if problem else self._execute(query, call)
            self._remember(call.id, answer)
            for waiting in self._held.pop(call.id):
                self._reply(waiting, answer)

        if len(self._held) >= MOST:
            raise Refused(f"{MOST} calls are already waiting", "wait until some are executed")
        if self._together[period] >= _AT_ONCE:
            raise Refused(
                f"{_AT_ONCE} calls are already waiting for this time, {at:g} s",
                "schedule the next ones for later",
            )
        # The clock may be set while the call waits.
        deadline = time.monotonic() + call.deadline - time.time()
        self._schedule.schedule(ScheduledCall(call.boot, at, deadline, settle))
        self._together[period] += 1
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
            name = str(encoding) if encoding is not None else ""
            request = codec.decode(self._service.request, payload, name)
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
        except Exception:  # noqa: BLE001 - every fault of a handler is answered
            # A fault in a handler must not end the process or leave its caller waiting.
            _log.exception("%s failed", self.key)
            return False, codec.encode_error(
                QuadctlError(f"{self.key} failed in its handler", "see the traceback in its log")
            )

    def _remember(self, call_id: str, answer: Answer) -> None:
        self._answers[call_id] = answer
        if len(self._answers) > _REMEMBERED:
            self._answers.popitem(last=False)


_STUCK = 1.0
"""Seconds without an answer after which a loop counts as stuck."""
_BUSY = codec.encode_error(
    Refused(f"{MOST} calls of this service already wait", "call again when they are answered")
)


class QueryQueue:
    """Queries of one key on their way to the loop; more than a mission sends are refused at once.

    So a flood costs its own callers their answers.
    """

    def __init__(
        self, executor: Executor, answer: Callable[[zenoh.Query], None], *, inline: bool
    ) -> None:
        self._executor, self._answer = executor, answer
        self._take = executor.run_inline if inline else executor.post
        # Each is counted by one thread at a time.
        self._came, self._answered, self._answered_at = 0, 0, 0.0

    def on_query(self, query: zenoh.Query) -> None:
        """Enqueue a query, on a Zenoh thread."""
        zenoh_events.pin_thread_state()
        if self._came - self._answered < MOST:
            self._came += 1
            self._take(lambda: self._on_turn(query))
            return
        with query:
            # To a supervisor any answer shows that the loop runs.
            if time.monotonic() - self._answered_at < _STUCK:
                query.reply_err(_BUSY, encoding=codec.ERROR_ENCODING)

    def _on_turn(self, query: zenoh.Query) -> None:
        self._answered, self._answered_at = self._answered + 1, time.monotonic()
        # Messages that came before the query count in its answer.
        self._executor.poll()
        self._answer(query)
