"""What is larger than the hub's room for one reader: it waits for him, and goes on reading others."""

import pytest
import zenoh

from tests.processes.lab import Lab


@pytest.mark.parametrize("size", [100_000, 8_000_000])
def test_a_query_of_megabytes_comes_through_whole_and_back(shared_lab: Lab, size: int):
    def echo(query: zenoh.Query) -> None:
        with query:
            assert query.payload is not None
            query.reply("stranger/echo", query.payload.to_bytes())

    sent = bytes(range(256)) * (size // 256)
    with shared_lab.bare() as server, shared_lab.bare() as caller:
        server.session.declare_queryable("stranger/echo", echo, complete=True)
        replies = [
            reply.ok.payload.to_bytes()
            for reply in caller.session.get("stranger/echo", payload=sent, timeout=20.0)
            if reply.ok is not None
        ]
        assert replies == [sent]
