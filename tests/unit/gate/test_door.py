"""Door with a router of the test behind it: its limits hold at once, and strangers cost little."""

import asyncio
import os
import ssl
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import msgspec
import pytest

from quadctl.services.gate.door import Budget, Door
from quadctl.services.runtime import procfs
from quadctl.services.runtime.bus.session import free_port
from quadctl.services.runtime.security.authority import Authority
from quadctl.services.runtime.security.identity import (
    ABOUT,
    CERTIFICATE,
    FLEET,
    KEY,
    Identity,
    Name,
)
from tests.support.running import DEADLINE, eventually
from tests.support.strangers import Strangers, client_hello

LINKS, TOO_MANY = 64, 40
HUB = Name("gate", "hub", ["*"], "00000001", time.time() + 3600)
BOB = Name("bob", "student", ["uav0"], "00000002", time.time() + 3600)


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a fleet's keys, and those of a hub and a student."""
    folder = tmp_path_factory.mktemp("keys")
    Authority.found(folder)
    for name in (HUB, BOB):
        Authority(folder).issue(name, ["127.0.0.1"], folder / name.name)
        (folder / name.name / ABOUT).write_bytes(msgspec.json.encode(name))
    return folder


@pytest.fixture
def door(keys: Path, tmp_path: Path) -> tuple[Door, int]:
    """Door that lets Bob in, and its port."""
    port = free_port()
    door = Door([f"tls/127.0.0.1:{port}"], Identity(str(keys / "gate")), tmp_path / "door")
    door.admit([BOB])
    return door, port


class Router:
    """Router that takes every link, and keeps the largest number of links at a time."""

    def __init__(self, door: Door) -> None:
        self.port = free_port()
        options = dict(o.split("=") for o in door.inner(self.port).partition("#")[2].split(";"))
        self._context = ssl.create_default_context(
            ssl.Purpose.CLIENT_AUTH, cafile=options["root_ca_certificate_file"]
        )
        self._context.load_cert_chain(
            options["listen_certificate_file"], options["listen_private_key_file"]
        )
        self._links = self.most = 0
        self.is_full = asyncio.Event()

    async def listen(self) -> asyncio.Server:
        """Listen on the port."""
        return await asyncio.start_server(self._take, "127.0.0.1", self.port, ssl=self._context)

    async def _take(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._links += 1
        self.most = max(self.most, self._links)
        if self.most >= LINKS:
            self.is_full.set()
        with aborted(writer):
            await reader.read()
        self._links -= 1


@contextmanager
def aborted(writer: asyncio.StreamWriter) -> Iterator[None]:
    """End a link at once: TLS closes in two steps, for which the test's loop would not live."""
    try:
        yield
    finally:
        writer.transport.abort()


def of_bob(keys: Path) -> ssl.SSLContext:
    context = ssl.create_default_context(cafile=keys / "bob" / FLEET)
    context.load_cert_chain(keys / "bob" / CERTIFICATE, keys / "bob" / KEY)
    return context


def test_a_name_has_no_more_links_than_its_limit_however_many_come_at_once(
    door: tuple[Door, int], keys: Path
):
    context, behind = of_bob(keys), Router(door[0])

    async def stay() -> None:
        """Come, and stay until sent away."""
        reader, writer = await asyncio.open_connection("127.0.0.1", door[1], ssl=context)
        with aborted(writer):
            await reader.read()

    async def rush() -> int:
        """Return how many are in when as many as are too many have been sent away."""
        server = await behind.listen()
        door[0].open(behind.port)
        clients = [asyncio.create_task(stay()) for _ in range(LINKS + TOO_MANY)]
        away = asyncio.as_completed(clients)
        for _ in range(TOO_MANY):
            await next(away)
        await behind.is_full.wait()
        found = sum(not client.done() for client in clients)
        for client in clients:
            client.cancel()
        await asyncio.wait(clients)
        server.close()
        return found

    async def in_time() -> int:
        return await asyncio.wait_for(rush(), DEADLINE)

    assert asyncio.run(in_time()) == behind.most == LINKS


def test_wildcards_that_were_asked_are_counted_once_and_for_ever():
    budget = Budget()
    assert budget.remember(BOB, {b"uav0/%d/*" % number for number in range(5000)})
    assert budget.remember(BOB, {b"uav0/0/*"}), "asked before, perhaps on another link"
    assert not budget.remember(BOB, {b"uav0/x/*"})
    assert budget.remember(HUB, {b"uav0/x/*"})


def test_an_unknown_protocol_ends_the_link(
    door: tuple[Door, int], keys: Path, caplog: pytest.LogCaptureFixture
):
    behind = Router(door[0])

    async def greet() -> bytes:
        server = await behind.listen()
        door[0].open(behind.port)
        reader, writer = await asyncio.open_connection("127.0.0.1", door[1], ssl=of_bob(keys))
        with aborted(writer), closing(server):
            writer.write(b"\x05\x00\x01\x0a\x12\x07\x07")
            try:
                return await asyncio.wait_for(reader.read(), DEADLINE)
            except ConnectionResetError:
                return b""

    assert asyncio.run(greet()) == b""
    assert "student.bob.00000002 sends no Zenoh 1.x" in caplog.text
    assert "protocol 10 of Zenoh, not 9" in caplog.text


def test_greetings_that_are_not_whole_cost_no_handshake(door: tuple[Door, int]):
    door[0].open(free_port())
    before = resident()
    with Strangers(door[1], 900, new=1, hello=client_hello()[:20]) as strangers:
        eventually(lambda: strangers.made >= 902)
        grown = resident() - before
    # A handshake takes more than 256 kB: 300 of them would take 77 MB.
    assert grown < 40e6


def resident() -> int:
    """Return this process's resident memory, bytes."""
    return procfs.stats_of(os.getpid()).rss or 0
