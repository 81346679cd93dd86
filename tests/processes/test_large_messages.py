"""What is larger than the hub's room for one reader: it waits for him, and nobody is cut off."""

import zenoh

from tests.processes.bare import Bare
from tests.processes.lab import private_lab

SIZE = 8_000_000


def test_a_query_of_megabytes_comes_through_whole_and_back():
    def echo(query: zenoh.Query) -> None:
        with query:
            assert query.payload is not None
            query.reply("stranger/echo", query.payload.to_bytes())

    sent = bytes(range(256)) * (SIZE // 256)
    # A lab of its own: were the hub to stop over it, all others of its tests would suffer.
    with private_lab() as lab:
        lab.start("--set", "dynamics.start.z=1")
        with lab.bare() as server, lab.bare() as caller, lab.bare() as third:
            server.session.declare_queryable("stranger/echo", echo, complete=True)
            poses = third.watch("uav/pose")
            assert asked(caller, sent) == [sent]
            stamps = [pose["stamp"] for pose in poses.next(20)]
            assert stamps == sorted(stamps)
            assert lab.nodes()["hub"]["restarts"] == 0


def asked(caller: Bare, sent: bytes) -> list[bytes]:
    replies = caller.session.get("stranger/echo", payload=sent, timeout=20.0)
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
