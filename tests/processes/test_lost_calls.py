"""A call that is lost on its way to another machine is sent again; one whose server ended is not."""

from collections.abc import Iterator
from typing import Any

import pytest
import zenoh

from quadctl.schemas.services import HoldResponse
from quadctl.services.runtime.bus import codec
from tests.processes.bare import pack, unpack
from tests.processes.lab import Lab, private_lab
from tests.processes.running import Done

KEY = "red/@srv/hold"
"""Of a vehicle that a bare program flies."""


def hold(room: Lab) -> Done:
    """The command, as from another machine."""
    there = f"unixsock-stream/{room.home / 'hub.sock'}"
    return room.quadctl("hold", "--vehicle", "red", "--connect", there)


@pytest.fixture(scope="module")
def room() -> Iterator[Lab]:
    with private_lab() as made:
        made.start()
        yield made


def test_what_got_no_answer_of_a_server_that_is_there_is_sent_again_with_its_id(room: Lab):
    ids: list[str] = []

    def answer(query: zenoh.Query) -> None:
        with query:
            assert query.attachment is not None
            ids.append(unpack(query.attachment.to_bytes())["id"])
            if len(ids) > 2:
                query.reply(KEY, pack({"success": True}), encoding=codec.encoding(HoldResponse))

    with room.bare() as bare, bare.session.declare_queryable(KEY, answer, complete=True):
        done = hold(room)
    assert done.code == 0, done.err
    assert ids == [ids[0]] * 3


def test_a_server_that_ended_in_mid_call_is_not_asked_again(room: Lab):
    asked: list[str] = []
    servers: list[Any] = []

    def ends(query: zenoh.Query) -> None:
        asked.append("first")
        servers.pop().undeclare()
        query.drop()

    with room.bare() as bare:
        servers.append(bare.session.declare_queryable(KEY, ends, complete=True))
        done = hold(room)
    assert done.code == 3
    assert "went away in mid-call: the outcome is unknown" in done.err
    assert asked == ["first"]
