"""The calls of one service, told as they are executed: recordings would not know them else."""

from typing import Any

import msgspec
import zenoh
from msgspec import Struct

from schemas.contract import Service
from schemas.messages import Called
from schemas.topics import called
from services.runtime.bus import wire
from services.runtime.bus.publisher import Publisher
from services.runtime.schedule import Schedule

_LONGEST = 1_000
"""Characters of an error that are told."""


class Journal:
    """Publishes each call on `VEHICLE/@call/SERVICE`, with the time that the schedule shows."""

    def __init__(
        self, session: zenoh.Session, vehicle: str, service: Service[Any, Any], schedule: Schedule
    ) -> None:
        topic = called(service)
        self._service, self._schedule = service, schedule
        self._calls = Publisher(session, topic.key(vehicle), topic)

    def tell(self, request: Struct, answer: tuple[bool, bytes], *, held: bool) -> None:
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
                "" if ok else wire.decode_error(payload).message[:_LONGEST],
            )
        )


def journal_of(
    session: zenoh.Session, vehicle: str, service: Service[Any, Any], schedule: Schedule
) -> Journal | None:
    """The journal of a service, None of one that changes nothing."""
    return None if service.reads else Journal(session, vehicle, service, schedule)
