"""`fuzz`: bursts of hostile payloads, none of them valid by chance, and a count of the replies."""

import random
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import cycle, islice
from typing import Annotated, Any, NamedTuple

import msgspec
from msgspec import Struct, inspect

from quadctl.cli import context, output
from quadctl.cli.context import Options, require_local
from quadctl.cli.declarations import Option
from quadctl.cli.node.lookup import run_of
from quadctl.cli.progress import Progress
from quadctl.schemas.services import GetParamsRequest
from quadctl.schemas.topics import SERVICES, STATE, TOPICS, get_params, set_params
from quadctl.schemas.typeinfo import described
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import Invalid, QuadctlError
from quadctl.services.runtime.process_table import NODES
from quadctl.services.runtime.security.endpoints import is_secure

_ODD: tuple[Any, ...] = (
    float("nan"), float("inf"), float("-inf"), 1e308, -10_000.001, 2**64 - 1, -(2**63), True, None,
    "", "nan", "x" * 5_000, b"\xff\x00", [], [1.0], {}, {"x": 1.0},
)  # fmt: skip
_DEEP = 9_000
"""Levels: as many as Python 3.13 reads, more than a thread of Zenoh has the stack for by itself."""
_NOWHERE = "application/msgpack;quadctl."
_ENCODINGS = (
    f"{_NOWHERE}Pose#00000000", f"{_NOWHERE}Nonsense#12345678", f"{_NOWHERE}#", _NOWHERE,
)  # fmt: skip


class HostilePayload(NamedTuple):
    """Bytes to send, their encoding, and the attachment of a call."""

    data: bytes
    encoding: str
    attachment: bytes | None = None


def refused(
    type_: type[Struct], draw: random.Random, *, called: bool = True
) -> Iterator[HostilePayload]:
    """Yield payloads without end that no reader of the type may accept; `called`: of a service."""
    ways = _WAYS if called else _WAYS[:-1]
    example = msgspec.to_builtins(_example(described(type_)))
    while True:
        payload = draw.choice(ways)(type_, example, draw)
        if not _is_valid(type_, payload):
            yield payload


def _is_valid(type_: type[Struct], payload: HostilePayload) -> bool:
    try:
        codec.decode(type_, payload.data, payload.encoding)
        codec.decode_call(payload.attachment)
    except Invalid:
        return False
    return True


def _noise(type_: type[Struct], _example: Any, draw: random.Random) -> HostilePayload:
    return HostilePayload(draw.randbytes(draw.randrange(200)), codec.encoding(type_))


def _flipped(type_: type[Struct], example: Any, draw: random.Random) -> HostilePayload:
    data = bytearray(codec.encode(example))
    for _ in range(draw.randint(1, 4)):
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    return HostilePayload(bytes(data), codec.encoding(type_))


def _cut_or_longer(type_: type[Struct], example: Any, draw: random.Random) -> HostilePayload:
    data = codec.encode(example)
    data = data[: draw.randrange(len(data))] if draw.random() < 0.5 else data + draw.randbytes(3)
    return HostilePayload(data, codec.encoding(type_))


def _odd_field(type_: type[Struct], example: Any, draw: random.Random) -> HostilePayload:
    return HostilePayload(codec.encode(_with_odd(example, draw)), codec.encoding(type_))


def _with_odd(value: Any, draw: random.Random) -> Any:
    """Return the value with an odd part, or with a field too many or too few."""
    if not isinstance(value, dict) or not value or draw.random() < 0.2:
        return draw.choice(_ODD)
    name = draw.choice(list(value))
    match draw.randrange(6):
        case 0:
            return {other: kept for other, kept in value.items() if other != name}
        case 1:
            return value | {"stranger": draw.choice(_ODD)}
        case _:
            return value | {name: _with_odd(value[name], draw)}


def _deep(type_: type[Struct], _example: Any, draw: random.Random) -> HostilePayload:
    return HostilePayload(draw.choice((b"\x91", b"\x81\xa1x")) * _DEEP, codec.encoding(type_))


def _mislabelled(_type: type[Struct], example: Any, draw: random.Random) -> HostilePayload:
    return HostilePayload(codec.encode(example), draw.choice(_ENCODINGS))


def _bad_attachment(type_: type[Struct], example: Any, draw: random.Random) -> HostilePayload:
    call = {"id": "fuzz", "deadline": 4e9} | {draw.choice(("id", "deadline")): draw.choice(_ODD)}
    attachment = (
        codec.encode(call) if draw.random() < 0.5 else draw.randbytes(draw.randrange(1, 60))
    )
    return HostilePayload(codec.encode(example), codec.encoding(type_), attachment)


_WAYS: tuple[Callable[[type[Struct], Any, random.Random], HostilePayload], ...] = (
    _noise, _flipped, _cut_or_longer, _odd_field, _odd_field, _deep, _mislabelled, _bad_attachment,
)  # fmt: skip


def _example(type_: inspect.Type) -> Any:
    """Return a valid value of a wire type."""
    match type_:
        case inspect.Metadata():
            return _example(type_.type)
        case inspect.StructType():
            return {field.encode_name: _example(field.type) for field in type_.fields}
        case inspect.LiteralType():
            return type_.values[0]
        case inspect.UnionType():
            return _example(type_.types[0])
    return _SIMPLE.get(type(type_))


_SIMPLE: dict[type[inspect.Type], Any] = {
    inspect.BoolType: True, inspect.IntType: 1, inspect.FloatType: 0.5, inspect.StrType: "a",
    inspect.ListType: [], inspect.DictType: {},
}  # fmt: skip
_MOST = 64  # queries waiting for a reply at a time


class Burst:
    """Counter of the replies; `taken` has the key of each reply that is no error."""

    def __init__(self, client: Client) -> None:
        self.codes: Counter[str] = Counter()  # error replies by code
        self.accepted: list[str] = []
        self.published = self.called = 0
        self._client = client
        self._room = threading.Semaphore(_MOST)
        self._lock = threading.Lock()

    @property
    def answered(self) -> int:
        """Return the number of queries with a reply."""
        return sum(self.codes.values()) + len(self.accepted)

    def publish(self, key: str, data: bytes, encoding: str) -> None:
        """Publish a payload on a key."""
        self.published += 1
        self._client.session.put(key, data, encoding=encoding)

    def call(self, key: str, data: bytes, encoding: str, attachment: bytes | None) -> bool:
        """Call a service; return False if none of the earlier calls was answered in time."""
        if not self._room.acquire(timeout=self._client.timeout):
            return False
        self.called += 1
        self._client.session.get(
            key,
            lambda reply: self._on_reply(key, reply),
            payload=data,
            encoding=encoding,
            attachment=attachment,
            timeout=self._client.timeout,
        )
        return True

    def settle(self) -> None:
        """Wait for the outstanding replies, up to the timeout for each."""
        for _ in range(_MOST):
            if not self._room.acquire(timeout=self._client.timeout):
                return
        self._room.release(_MOST)

    def _on_reply(self, key: str, reply: Any) -> None:
        with self._lock:
            if reply.ok is not None:
                self.accepted.append(key)
            else:
                self.codes[_code(reply.err)] += 1
        self._room.release()


def _code(error: Any) -> str:
    if str(error.encoding) != codec.ERROR_ENCODING:
        return "no answer"
    problem: QuadctlError = codec.decode_error(error.payload.to_bytes())
    return problem.code


class _Target(NamedTuple):
    key: str
    type: type[Struct]
    is_service: bool


def fuzz(
    options: Options,
    payloads: Annotated[int, Option("How many to send in total.", metavar="N", min=1)] = 2_000,
    seed: Annotated[int, Option("Seed of the random numbers.", min=0)] = 0,
) -> None:
    """Send invalid payloads to every topic and service, and check that none is accepted.

    Noise, valid ones with bits flipped, cut or mislabelled, NaN and infinity in every field, deep
    nesting. Exit 8 if one was accepted or not answered, a process ended, or a valid call afterwards
    got no answer. Only for a vehicle that you alone are flying.

    Example: quadctl fuzz --payloads 100000 --seed 1
    """
    if is_secure(options.connect):
        # Payloads that a role keeps out would prove nothing.
        require_local(options, "fuzz")
    with context.connect(options) as client:
        before = _snapshot(client, options)
        burst = Burst(client)
        with Progress("sending", quiet=options.json) as progress:
            for number, (target, payload) in enumerate(_plan(client.vehicle, payloads, seed)):
                if not _send(burst, target, payload):
                    break
                if number % 100 == 0:
                    progress.update(number / payloads, f"{number} of {payloads}")
        burst.settle()
        faults = list(_faults(client, burst, before, _snapshot(client, options)))
    document = {
        "ok": not faults, "payloads": burst.called + burst.published, "seed": seed,
        "published": burst.published, "asked": burst.called, "replies": dict(burst.codes),
        "faults": faults,
    }  # fmt: skip
    if options.json:
        output.document(document)
    else:
        _print(document)
    output.end(ok=not faults)


def _plan(vehicle: str, count: int, seed: int) -> Iterator[tuple[_Target, HostilePayload]]:
    topics = [_Target(topic.key(vehicle), topic.type, False) for topic in TOPICS]
    params = [make(node) for node in NODES for make in (get_params, set_params)]
    services = [_Target(s.key(vehicle), s.request, True) for s in (*SERVICES, *params)]
    draw = random.Random(seed)
    streams = [
        (target, refused(target.type, draw, called=target.is_service))
        for target in (*topics, *services)
    ]
    for target, stream in islice(cycle(streams), count):
        yield target, next(stream)


def _send(burst: Burst, target: _Target, payload: HostilePayload) -> bool:
    if target.is_service:
        return burst.call(target.key, payload.data, payload.encoding, payload.attachment)
    burst.publish(target.key, payload.data, payload.encoding)
    return True


def _snapshot(client: Client, options: Options) -> dict[str, Any]:
    """Return the values that must be the same afterwards."""
    client.flush()
    state = client.latest(STATE)
    found: dict[str, Any] = {
        "boot": state.boot, "requests": state.request, "goal": state.goal, "cage_on": state.cage_on,
    }  # fmt: skip
    run = run_of(options)
    return found | {f"process of {node.name}": node.pid for node in (run.nodes if run else ())}


def _faults(
    client: Client, burst: Burst, before: dict[str, Any], after: dict[str, Any]
) -> Iterator[str]:
    for key in sorted(set(burst.accepted)):
        yield f"{key} took {burst.accepted.count(key)}"
    missing = burst.called - burst.answered + burst.codes["no answer"]
    if missing:
        yield f"{missing} calls were not answered"
    for name, value in before.items():
        if after.get(name) != value:
            yield f"{name}: {value} before, {after.get(name)} after"
    for node in client.nodes():
        try:
            client.call(get_params(node), GetParamsRequest([]))
        except QuadctlError as problem:
            yield f"{node} does not answer a valid call: {problem.message}"


def _print(document: dict[str, Any]) -> None:
    output.line(
        f"{document['payloads']} payloads, seed {document['seed']}: {document['published']}"
        f" published, {document['asked']} asked"
    )
    for code, count in sorted(document["replies"].items()):
        output.line(f"refused as {code}: {count}")
    for fault in document["faults"]:
        output.line(f"FAULT: {fault}")
    if document["ok"]:
        output.line("none was accepted, no process ended, and each answers the next valid call")
