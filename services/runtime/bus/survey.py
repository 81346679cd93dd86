"""What a look at the bus found: who is there, what came, and how each service answered."""

from typing import Any, NamedTuple

import zenoh
from msgspec import Struct, field

from schemas.requests import GetParamsResponse
from services.runtime.bus import graph, wire
from services.runtime.bus.heard import Heard
from services.runtime.errors import Invalid, TimedOut


class Answer(NamedTuple):
    """One server's answer: empty `code` for a reply, else the error's, or `timeout`."""

    server: str
    code: str
    seconds: float
    values: dict[str, Any]


class Survey(Struct):
    """What was found: times in s, topics and services by their full keys."""

    connected: float = 0.0
    listened: float = 0.0
    nodes: list[str] = field(default_factory=list)
    offers: list[graph.Offer] = field(default_factory=list)
    heard: dict[str, Heard] = field(default_factory=dict)
    answers: dict[str, list[Answer]] = field(default_factory=dict)


def answer_of(reply: zenoh.Reply, seconds: float) -> Answer:
    """What a reply to a call says, and after how many seconds it came."""
    server = str(reply.replier_id.zid) if reply.replier_id else ""
    if reply.ok is not None:
        said = str(reply.ok.encoding)
        if said != wire.encoding(GetParamsResponse):
            return Answer(server, "", seconds, {})
        try:
            values = wire.decode(GetParamsResponse, reply.ok.payload.to_bytes(), said).values
        except Invalid as error:
            return Answer(server, error.code, seconds, {})
        return Answer(server, "", seconds, values)
    if reply.err is None or str(reply.err.encoding) != wire.ERROR_ENCODING:
        return Answer(server, TimedOut.code, seconds, {})
    return Answer(server, wire.decode_error(reply.err.payload.to_bytes()).code, seconds, {})
