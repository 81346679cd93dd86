"""Stand-ins for the queries that Zenoh passes to a service's server."""

from typing import Any, Self

import msgspec

from quadctl.schemas.services import Call, GotoRequest, GotoResponse
from quadctl.schemas.topics import GOTO
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.server import Schedule, Server

KEY = "uav/@srv/goto"
ASK = codec.encode(GotoRequest(1.0, 2.0, 3.0))


class Bytes:
    def __init__(self, data: bytes) -> None:
        self._data = data

    def to_bytes(self) -> bytes:
        return self._data


class Query:
    """Stand-in for a Zenoh query; it must be answered once and then closed."""

    def __init__(
        self,
        payload: bytes | None = ASK,
        *,
        key: str = KEY,
        encoding: str | None = "",
        call: Call | bytes | None = None,
    ) -> None:
        self.key_expr, self.encoding = key, encoding
        self.payload = None if payload is None else Bytes(payload)
        attached = codec.encode(call) if isinstance(call, Call) else call
        self.attachment = None if attached is None else Bytes(attached)
        self.replies: list[tuple[str, Any]] = []
        self.open = False

    def __enter__(self) -> Self:
        self.open = True
        return self

    def __exit__(self, *_: object) -> None:
        self.open = False

    def reply(self, key: str, payload: bytes, *, encoding: str) -> None:
        assert (self.open, key, encoding) == (True, KEY, codec.encoding(GotoResponse))
        self.replies.append(("ok", codec.decode(GotoResponse, payload, encoding)))

    def reply_err(self, payload: bytes, *, encoding: str) -> None:
        assert (self.open, encoding) == (True, "application/json;quadctl.Error")
        self.replies.append(("error", msgspec.json.decode(payload)))


class Bench:
    """Goto service that records the executed requests."""

    def __init__(self, fault: Exception | None = None) -> None:
        self.executed: list[GotoRequest] = []
        self.fault = fault
        self.schedule = Schedule(lockstep=True)
        self.server = Server("uav", GOTO, self._goto, self.schedule)

    def _goto(self, request: GotoRequest) -> GotoResponse:
        self.executed.append(request)
        if self.fault is not None:
            raise self.fault
        return GotoResponse(True, f"number {len(self.executed)}")

    def ask(self, *args: Any, **kwargs: Any) -> tuple[str, Any]:
        query: Any = Query(*args, **kwargs)
        self.server.answer(query)
        assert not query.open
        (reply,) = query.replies
        return reply

    def fails(self, code: str, *args: Any, **kwargs: Any) -> dict[str, str]:
        kind, error = self.ask(*args, **kwargs)
        assert (kind, error["code"]) == ("error", code)
        return dict(error)
