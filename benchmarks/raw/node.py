"""Ends of a service and a topic on bare Zenoh: `node.py ENDPOINT NAME ROLE BYTES`.

They have no types and no guarantees. ROLE is serve, call, listen, publish, or ping (publish, and wait
for the answer of pong); payloads have BYTES bytes. As `publish_pose` and `listen_pose` they encode and
decode poses, as a person writes it by hand. The route (clients of a hub on a Unix socket) and
`ZENOH_RUNTIME` are the same as ours.
"""

import struct
import sys
import time
from collections.abc import Callable
from queue import SimpleQueue

import zenoh

from benchmarks.raw.session import opened
from benchmarks.worker import Arrivals, flood, paced, serve, timed

SERVICE, TOPIC, ANSWER = "raw/@srv/toggle_cage", "raw/pose", "raw/setpoint"
_STAMP = struct.Struct("<d")


def main(endpoint: str, role: str, size: str) -> None:
    """Run one end of a service or a topic."""
    session = opened(endpoint)
    filling = bytes(int(size))
    if role == "call":

        def call() -> None:
            for reply in session.get(SERVICE, payload=filling, timeout=3.0):
                reply.ok.payload.to_bytes()

        serve(call=lambda count: timed(call, count))
    if role == "serve":

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(SERVICE, query.payload.to_bytes())

        server = session.declare_queryable(SERVICE, answer, complete=True)
        serve(served=lambda: str(server.key_expr))
    if role == "pong":
        answers = session.declare_publisher(ANSWER)
        monitor = session.declare_subscriber(TOPIC, lambda _sample: answers.put(filling))
        serve(heard=lambda: str(monitor.key_expr))
    if role == "ping":
        publisher, came = session.declare_publisher(TOPIC), SimpleQueue[bytes]()
        answered = session.declare_subscriber(ANSWER, lambda s: came.put(s.payload.to_bytes()))

        def trip() -> None:
            publisher.put(filling)
            came.get(timeout=3.0)

        serve(
            connected=lambda: bool(publisher.matching_status.matching),
            trip=lambda count: timed(trip, count),
            heard=lambda: str(answered.key_expr),
        )
    made, stamp_of = _typed() if role.endswith("_pose") else _untyped(filling)
    if role.startswith("publish"):
        publisher = session.declare_publisher(TOPIC)

        def put(number: int) -> None:
            publisher.put(made(number))

        serve(
            publish=lambda count, hz: paced(put, count, hz),
            flood=lambda seconds: flood(put, seconds),
        )
    arrivals = Arrivals()

    def heard(sample: zenoh.Sample) -> None:
        arrivals.add(stamp_of(sample.payload.to_bytes()))

    subscriber = session.declare_subscriber(TOPIC, heard)
    serve(take=arrivals.take, rate=arrivals.rate, heard=lambda: str(subscriber.key_expr))


_Form = tuple[Callable[[int], bytes], Callable[[bytes], float]]
"""Makes a message with the time, by its number; returns the time in a message."""


def _untyped(filling: bytes) -> _Form:
    rest = filling[_STAMP.size :]
    return lambda _: _STAMP.pack(time.monotonic()) + rest, lambda data: _STAMP.unpack_from(data)[0]


def _typed() -> _Form:
    # Imported here: the other ends have nothing of ours in memory.
    import msgspec

    from benchmarks.ours.node import pose
    from quadctl.schemas.messages import Pose

    decode = msgspec.msgpack.Decoder(Pose).decode
    return lambda number: msgspec.msgpack.encode(pose(number)), lambda data: decode(data).stamp


if __name__ == "__main__":
    main(*sys.argv[1:])
