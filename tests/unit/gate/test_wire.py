"""Declarations counted in Zenoh's traffic: in messages written here, and in that of Zenoh itself."""

import json
import multiprocessing
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

import pytest
import zenoh
from hypothesis import given, strategies as st

from quadctl.services.gate.wire import PROTOCOL, Declarations, MalformedBatch
from quadctl.services.runtime.bus.session import free_port
from tests.support.running import eventually
from tests.support.tap import Tap

SUBSCRIBER, QUERYABLE, TOKEN = 0x02, 0x04, 0x06
AS_ROUTER, AS_CLIENT = 0, 2
FRAME = b"\x25\x00"
WILD = 16
"""Cost of a declaration with a wildcard."""


def batch(*messages: bytes) -> bytes:
    """Return a batch with one frame."""
    return sized(FRAME + b"".join(messages))


def sized(body: bytes) -> bytes:
    return len(body).to_bytes(2, "little") + body


def greeting(mode: int = AS_CLIENT, version: int = PROTOCOL, patch: bytes = b"\x27\x01") -> bytes:
    """Return the first message of an end."""
    return bytes([0x81 if patch else 0x01, version, 0x10 | mode, 7, 7]) + patch


def declared(kind: int, number: int, key: bytes, scope: int = 0) -> bytes:
    """Return a declaration of a key appended to the client's own key `scope`, 0 for none."""
    return bytes([0x1E, kind | 0x60, number, scope, len(key)]) + key


def withdrawn(kind: int, number: int) -> bytes:
    return bytes([0x1E, kind + 1, number])


def key(number: int, name: bytes) -> bytes:
    return bytes([0x1E, 0x20, number, 0, len(name)]) + name


def refused(stream: bytes) -> None:
    with pytest.raises(MalformedBatch):
        Declarations().feed(stream)


def cost(*messages: bytes) -> int:
    counted = Declarations()
    counted.feed(batch(*messages))
    return counted.cost


def test_each_declaration_counts_until_it_is_withdrawn():
    here = [declared(kind, 1, b"uav/own/x") for kind in (SUBSCRIBER, QUERYABLE, TOKEN)]
    assert cost(*here) == 3
    assert cost(*here, declared(SUBSCRIBER, 2, b"uav/pose")) == 4
    assert cost(*here, here[0]) == 3, "the same one again"
    assert cost(*here, *(withdrawn(kind, 1) for kind in (SUBSCRIBER, QUERYABLE, TOKEN))) == 0
    assert cost(withdrawn(SUBSCRIBER, 1)) == 0


def test_a_number_stands_for_one_declaration():
    # Zenoh would keep the first one for ever, and let the number be withdrawn twice.
    refused(batch(declared(TOKEN, 1, b"uav/@node/a"), declared(TOKEN, 1, b"uav/@node/b")))
    again = [key(1, b"uav/**"), key(1, b"uav/own")]
    below = declared(SUBSCRIBER, 1, b"/x", scope=1)
    assert cost(*again, below) == 1 + 2 * WILD, "Zenoh ignores the second key"
    assert cost(again[0], bytes([0x1E, 0x01, 1]), again[1], below) == 2


def test_wildcards_cost_more_also_by_a_declared_key():
    for wild in (b"uav/**", b"*/pose", b"uav/own/a$*"):
        assert cost(declared(SUBSCRIBER, 1, wild)) == WILD
        assert cost(key(1, wild)) == WILD
        assert cost(key(1, wild), declared(QUERYABLE, 1, b"/x", scope=1)) == 2 * WILD
    assert cost(key(1, b"uav/own"), declared(QUERYABLE, 1, b"/x", scope=1)) == 2


def interest(mode: int, number: int, name: bytes) -> bytes:
    return bytes([0x19 | mode << 5, number, 0x38, 0, len(name)]) + name


def test_the_wildcards_of_interests_are_remembered():
    counted = Declarations()
    counted.feed(batch(interest(1, 1, b"*/@node/*"), interest(3, 2, b"uav/**")))
    counted.feed(batch(interest(1, 3, b"uav/@node/x"), bytes([0x19, 2])))
    assert counted.cost == 0
    assert counted.asked == {b"*/@node/*", b"uav/**"}


def test_a_router_names_what_it_withdraws():
    name = b"uav/own/x"
    here = [declared(SUBSCRIBER, 0, name), declared(SUBSCRIBER, 0, b"uav/pose")]
    extension = bytes([0x5F, 2 + len(name), 1, 0]) + name
    gone = bytes([0x1E, 0x83, 0]) + extension
    unnamed = bytes([0x1E, 0x83, 0]) + extension.replace(b"\x01\x00", b"\x00\x00", 1)
    for then, left in ([], 2), ([gone], 1), ([gone, gone], 1), ([unnamed], 2):
        counted = Declarations(Declarations())
        counted.feed(sized(greeting(AS_ROUTER)) + batch(*here, *then))
        assert counted.cost == left, "without a name Zenoh does not know what is meant"
    refused(sized(greeting(AS_ROUTER)))  # whose certificate is not a hub's


def test_the_other_ends_keys_are_known():
    there = Declarations()
    there.feed(batch(key(7, b"uav/**")))
    here = Declarations(there)
    here.feed(batch(bytes([0x1E, SUBSCRIBER, 1, 7])))
    assert here.cost == WILD
    assert cost(bytes([0x1E, SUBSCRIBER, 1, 7])) == WILD, "unknown, so the worst"


def test_a_declaration_in_fragments_is_refused():
    piece = declared(SUBSCRIBER, 1, b"uav/pose")[:4]
    refused(sized(greeting()) + sized(b"\xe6\x00\x02" + piece))
    # Zenoh drops such a piece, unless it continues a message.
    Declarations().feed(sized(greeting()) + sized(b"\x66\x00" + piece))
    # An end of before Zenoh 1.1 marks no first piece, and Zenoh may take any for one.
    refused(sized(greeting(patch=b"")) + sized(b"\x66\x00" + piece))


@pytest.mark.parametrize("first", [b"\x03\x00", b"\x42\x0a\x00\x01c", b"\x04"])
def test_what_follows_another_message_in_a_batch_counts(first: bytes):
    counted = Declarations()
    counted.feed(sized(greeting()) + sized(first + batch(declared(TOKEN, 1, b"uav/@node/x"))[2:]))
    assert counted.cost == 1


def test_an_end_greets_once_and_in_the_known_protocol():
    refused(sized(greeting()) + sized(greeting()))
    with pytest.raises(MalformedBatch, match="protocol 10"):
        Declarations().feed(sized(greeting(version=10)))


STAMP, RESPONDER, SOURCE = b"\x01\x01\x01", b"\x00\x01\x01", b"\x00\x01\x01\x01"
PUSH = b"\xbd\x00\x01k"
"""Begin of a push with extensions."""
REPLY = b"\xbb\x01\x00\x01k"


@pytest.mark.parametrize(
    ("begin", "extension", "content", "end"),
    [
        (PUSH, 0x42, STAMP, b"\x01\x00"),
        (PUSH, 0x47, STAMP, b"\x01\x00"),
        (REPLY, 0x43, RESPONDER, b"\x04\x01\x00"),
        (b"\x3d\x00\x01k\x81", 0x41, SOURCE, b"\x00"),
        (b"\x3c\x01\x00\x01k\x83", 0x41, SOURCE, b""),
    ],
)
def test_no_declaration_hides_in_an_extension(
    begin: bytes, extension: int, content: bytes, end: bytes
):
    """Zenoh would read these by their content, and take what is left of the length for messages."""
    hidden = end + declared(TOKEN, 1, b"uav/@node/x")
    length = len(content) + len(hidden)
    refused(batch(begin + bytes([extension, length]) + content + hidden + end))
    if extension in {0x41, 0x43}:
        assert cost(begin + bytes([extension, len(content)]) + content + hidden) == 1
    twice = bytes([extension | 0x80, length]) + content + hidden
    refused(batch(begin + twice + bytes([extension, len(content)]) + content + end))


@pytest.mark.parametrize(
    "body",
    [
        b"\x25",  # a frame without its number
        b"\x25\x00\x12",  # no such message
        b"\x25\x00" + declared(SUBSCRIBER, 1, b"uav/pose")[:-1],  # cut short
        b"\x25\x00\x1d\x00\x81\x92\x00",  # shared memory
        b"\x25\x00\x1c\x01\x00\x83\x84\x43\x01\x00",  # the same in a query
    ],
)
def test_what_cannot_be_read_is_refused(body: bytes):
    refused(sized(body))


@given(st.text("a/*$#?@%", max_size=8))
def test_only_what_zenoh_takes_for_a_key_expression_is_let_through(name: str):
    """A router that has stored any other key panics at the next one, and serves nobody new."""
    try:
        zenoh.KeyExpr(name)
    except zenoh.ZError:
        refused(batch(key(1, name.encode())))
        refused(batch(interest(1, 1, name.encode())))
        if name:
            gone = bytes([0x1E, 0x87, 1, 0x5F, 2 + len(name), 1, 0]) + name.encode()
            refused(batch(gone))
    else:
        assert cost(key(1, name.encode())) == (WILD if "*" in name else 1)


def test_a_key_of_very_many_chunks_is_refused():
    """It would take megabytes, and overflow the stack of a router that forgets it."""
    assert cost(declared(TOKEN, 1, b"a" + b"/a" * 31)) == 1
    refused(batch(declared(TOKEN, 1, b"a" + b"/a" * 32)))
    assert cost(key(1, b"a" * 100), key(2, b"a" + b"/a" * 20)) == 2
    refused(batch(key(1, b"a" + b"/a" * 20), declared(TOKEN, 1, b"/a" * 20, scope=1)))


@given(st.lists(st.binary(max_size=40), max_size=20))
def test_garbage_is_refused_or_counted_and_costs_nothing_below_0(pieces: list[bytes]):
    counted = Declarations()
    for piece in pieces:
        with suppress(MalformedBatch):
            counted.feed(len(piece).to_bytes(2, "little") + piece)
        assert counted.cost >= 0


@given(st.data())
def test_the_stream_may_be_cut_anywhere(data: st.DataObject):
    whole = batch(key(1, b"uav/**"), declared(SUBSCRIBER, 1, b"/x", scope=1))
    whole += batch(declared(TOKEN, 1, b"uav/@node/x")) + batch(withdrawn(TOKEN, 1))
    counted, at = Declarations(), 0
    while at < len(whole):
        to = data.draw(st.integers(at + 1, len(whole)))
        counted.feed(whole[at:to])
        at = to
    assert counted.cost == 2 * WILD


def config(mode: str, **endpoints: list[str]) -> str:
    return json.dumps(
        {
            "mode": mode,
            **{way: {"endpoints": places} for way, places in endpoints.items()},
            "scouting": {"delay": 0, "multicast": {"enabled": False}},
            "timestamping": {"enabled": True},
            # A busy machine may not run one side for long; a new link would declare all again.
            "transport": {"shared_memory": {"enabled": False}, "link": {"tx": {"lease": 60_000}}},
        }
    )


ROUTER = """
import sys, zenoh
with zenoh.open(zenoh.Config.from_json5(sys.argv[1])) as router:
    router.declare_subscriber("a/**", lambda _sample: None)
    print("open", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def tap() -> Iterator[Tap]:
    """Tap in front of a router, which has a process of its own.

    The tests' process may have one Zenoh thread, too few for a router.
    """
    port = free_port()
    router = subprocess.Popen(
        [sys.executable, "-c", ROUTER, config("router", listen=[f"tcp/127.0.0.1:{port}"])],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    with router, Tap(port) as made:
        assert router.stdout is not None
        assert router.stdout.readline() == "open\n"
        yield made


def client(place: str) -> zenoh.Session:
    return zenoh.open(zenoh.Config.from_json5(config("client", connect=[f"tcp/{place}"])))


def use_everything(session: zenoh.Session) -> list[Any]:
    """Send every kind of message; return what is declared."""
    held: list[Any] = [
        session.declare_subscriber("a/3", lambda _sample: None),
        session.declare_subscriber("b/**", lambda _sample: None),
        session.liveliness().declare_token("t/x"),
        session.liveliness().declare_subscriber("t/**", lambda _sample: None),
    ]

    def answer(query: zenoh.Query) -> None:
        with query:
            if query.parameters:
                query.reply_err(b"no", encoding="a/b;c")
            else:
                query.reply("q/x", b"y" * 70_000, attachment=b"z")

    held.append(session.declare_queryable("q/x", answer, complete=True))
    block = zenoh.CongestionControl.BLOCK
    publisher = session.declare_publisher("a/3", encoding="zenoh/bytes;x", congestion_control=block)
    publisher.declare_matching_listener(lambda _status: None)
    held.append(publisher)
    for size in (0, 200, 70_000):
        publisher.put(b"x" * size, attachment=b"y")
        session.put("a/9", b"c" * size, priority=zenoh.Priority.REAL_TIME, congestion_control=block)
    session.delete("a/4")
    for asked in ("q/x", "q/x?a=1", "**"):
        list(session.get(asked, payload=b"p", attachment=b"q", timeout=2.0))
    return held


def declare_and_withdraw(place: str, test: Connection) -> None:
    """Use everything and then nothing, with a word to the test after each."""
    with client(place) as session:
        held = use_everything(session)
        with client(place) as other:
            # The router's way to the queryable may be new again after the first answer.
            eventually(lambda: list(other.get("q/x")))
            eventually(lambda: list(other.get("q/x?a=1")))
        # The link keeps the order: with this answer all declarations have been counted.
        list(session.liveliness().get("**"))
        test.send("declared")
        test.recv()
        for one in reversed(held):
            one.undeclare()
        list(session.liveliness().get("**"))
        test.send("withdrawn")


@pytest.fixture
def program(tap: Tap) -> Iterator[Connection]:
    """Client in a process of its own, with Zenoh's usual threads.

    The tests' process may have one, which waits for ever for room if it ends an answer larger than the queue.
    """
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(
        target=declare_and_withdraw, args=(tap.place, there)
    )
    process.start()
    there.close()  # so that the end of the process ends a wait for its word
    with here:
        yield here
    process.join()
    assert process.exitcode == 0


def test_this_zenoh_speaks_the_protocol_that_is_read(tap: Tap):
    with client(tap.place):
        sent = b"".join(tap.sent[0])
    begin = sent[2 : 2 + int.from_bytes(sent[:2], "little")]
    assert begin[0] & 0x1F == 1
    assert begin[1] == PROTOCOL, "another protocol: read zenoh-codec, and write wire.py anew"
    options = begin[4 + (begin[2] >> 4) :]
    assert options[-2:] == b"\x27\x01", "another patch of it: compare wire.py with zenoh-codec"


def test_no_rule_of_this_zenoh_limits_declarations():
    """If this fails, Zenoh may have got what wire.py is for."""
    data = {"put", "delete", "query"}
    known = {
        '{access_control: {rules: [{messages: ["?"]}]}}': {*data, "reply", "declare_subscriber"}
        | {"declare_queryable", "liveliness_token", "liveliness_query"}
        | {"declare_liveliness_subscriber"},
        "{access_control: {rules: [{?: 1}]}}": {"id", "key_exprs", "messages", "flows"}
        | {"permission"},
        '{downsampling: [{messages: ["?"]}]}': {*data, "reply"},
        '{low_pass_filter: [{messages: ["?"]}]}': {*data, "reply"},
        '{qos: {network: [{messages: ["?"]}]}}': data,
        "{transport: {unicast: {?: 1}}}": {"open_timeout", "accept_timeout", "accept_pending"}
        | {"max_sessions", "max_links", "lowlatency", "qos", "compression"},
    }
    for config, words in known.items():
        with pytest.raises(zenoh.ZError) as unknown:
            zenoh.Config.from_json5(config.replace("?", "unheard_of"))
        assert set(re.findall("`(.+?)`", str(unknown.value))) == {"unheard_of", *words}


def test_all_that_a_client_sends_is_read(tap: Tap, program: Connection):
    assert program.recv() == "declared"
    found = Declarations()
    found.feed(b"".join(tap.sent[0]))
    most, seen = found.cost, len(tap.sent[0])
    assert most >= 3 + 2 * WILD  # a/3, t/x and q/x, b/**, t/**
    program.send("go on")
    assert program.recv() == "withdrawn"
    found.feed(b"".join(tap.sent[0][seen:]))
    assert found.cost <= most - 3 - 2 * WILD  # Zenoh keeps the numbers of keys
    assert sum(map(len, tap.sent[0])) > 140_000
