"""Door: the gate's TLS listeners, which let in only holders of a valid, listed certificate.

Zenoh's own listener pauses for 0.1 s after each handshake that fails, and no setting limits what a
client declares. So strangers end here, and each client is passed on to Zenoh by a loopback link,
with a certificate made here for its role and vehicles. That one grants the rights of the list.
"""

import asyncio
import logging
import resource
import shutil
import socket
import ssl
import threading
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import cast

from quadctl.schemas.roles import EVERY
from quadctl.services.gate.wire import Declarations, MalformedBatch
from quadctl.services.runtime.errors import QuadctlError, UsageError
from quadctl.services.runtime.security.access_control import member
from quadctl.services.runtime.security.authority import Authority
from quadctl.services.runtime.security.identity import CERTIFICATE, FLEET, KEY, Identity, Name

_HANDSHAKE = 3.0
"""Seconds for the ClientHello, and again for the handshake; over a bad network it takes 0.5 s."""
_MOST_WAITING = 1000
"""Connections without a whole ClientHello yet; the oldest makes room for the next."""
_MOST_GREETED = 200
"""Handshakes at a time, each of which takes a quarter of a megabyte; the oldest makes room, too."""
_HANDSHAKE_TYPE, _HEADER, _LARGEST = 22, 5, 2**14
"""First byte of a TLS record with a ClientHello, bytes of its header, and most after it (RFC 8446, 5.1)."""
_MOST_FILES = 65_536
_MOST_LINKS = 64
"""Connections of one name."""
_MOST_DECLARED = 1000
"""Cost of what one name may have declared at a time, for each of its vehicles (see wire.py). The
router takes at most 40 ms to forget it, and delays all messages meanwhile. Our own nodes need 150."""
_MOST_ASKED = 5000
"""Wildcards in one name's interests, e.g. its questions for live nodes: 4 for each vehicle. A router
never forgets one, and 5000 that match one another take 270 MB."""
_BARRED = 10.0
"""Seconds for which a name with too many is not let in: it would declare them again at once."""
_KEPT_WAITING = 0.5
"""Seconds before a name that is not on the list is sent away: the list may be about to change, and
who is sent away tries again, for ever."""
_FOR_EVER = 10 * 365 * 86_400.0
"""Seconds; the door itself ends a link when the client's own certificate expires."""
_REOPENING, _AGAIN = 3.0, 0.02
"""Seconds that a client waits for the router, and between two attempts."""
_ROOM = 65_536
"""Bytes that may wait for a side that does not read, beyond the kernel's buffers."""
_REPORTS = 60.0
"""Least seconds between two log lines about strangers."""

_Strangers = OrderedDict[socket.socket, asyncio.Task[None]]

_log = logging.getLogger("gate")


class Door:
    """TLS listeners on a thread of their own, until the process ends."""

    def __init__(self, endpoints: Sequence[str], identity: Identity, folder: Path) -> None:
        """Listen at the endpoints; `folder` is for the keys made here. Raises QuadctlError."""
        self._names: dict[str, Name] = {}
        self._listeners = [_listener(endpoint) for endpoint in endpoints]
        shutil.rmtree(folder, ignore_errors=True)
        Authority.found(folder)
        self._folder, self._authority = folder, Authority(folder)
        self._server = ssl.create_default_context(
            ssl.Purpose.CLIENT_AUTH, cafile=identity.path(FLEET)
        )
        self._server.verify_mode = ssl.CERT_REQUIRED
        self._server.minimum_version = ssl.TLSVersion.TLSv1_3  # as Zenoh's clients
        self._identity = identity
        self._contexts: dict[str, ssl.SSLContext] = {}
        # Zenoh's end of the loopback links: the fleet's certificate may expire or be replaced.
        router = Name("router", "hub", [EVERY], "door", time.time() + _FOR_EVER)
        self._authority.issue(router, ["127.0.0.1"], folder / "router")
        self._waiting: _Strangers = OrderedDict()
        self._greeted: _Strangers = OrderedDict()
        self._coming = Counter[str]()
        self._turn = asyncio.Lock()
        self._links: set[_Link] = set()
        self._declared = Budget()
        self._failed, self._reported = 0, -_REPORTS
        self._port = 0
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def inner(self, port: int) -> str:
        """Return the endpoint at which a router must listen for the door's links."""
        files = {
            "root_ca_certificate_file": self._folder / FLEET,
            "listen_certificate_file": self._folder / "router" / CERTIFICATE,
            "listen_private_key_file": self._folder / "router" / KEY,
        }
        options = ";".join(f"{name}={file}" for name, file in files.items())
        return f"tls/127.0.0.1:{port}#{options}"

    def open(self, port: int) -> None:
        """Let clients in, from now on to the router at this port."""
        self._port = port
        if self._thread.is_alive():
            return
        # A connection is a file; the usual limit of 1024 is only the shell's.
        _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(most, _MOST_FILES), most))
        self._thread.start()

    def admit(self, names: Iterable[Name]) -> None:
        """Take a new list of names, and end the links of those that are no longer on it.

        Our own certificate may be new as well. Raises OSError if it cannot be read.
        """
        self._server.load_cert_chain(self._identity.path(CERTIFICATE), self._identity.path(KEY))
        self._loop.call_soon_threadsafe(self._admit, {name.common_name: name for name in names})

    def ports(self) -> set[int]:
        """Return the ports of the routers that have links."""
        return {link.port for link in list(self._links)}

    def end_links(self) -> None:
        """End all links at once; Zenoh would end them one after the other, each in 0.1 s."""
        self._loop.call_soon_threadsafe(self._end, lambda _name: True)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        for listener in self._listeners:
            self._loop.create_task(self._accept(listener))
        self._loop.run_forever()

    def _admit(self, names: dict[str, Name]) -> None:
        self._names = names
        # The same certificate may have other rights now.
        self._end(lambda name: names.get(name.common_name) != name)

    def _end(self, ends: Callable[[Name], bool]) -> None:
        for link in [link for link in self._links if ends(link.name)]:
            link.end()

    async def _accept(self, listener: socket.socket) -> None:
        while True:
            try:
                stranger, _ = await self._loop.sock_accept(listener)
            except OSError:  # too many open files
                _drop_oldest(self._waiting or self._greeted)
                await asyncio.sleep(0.01)
                continue
            if len(self._waiting) >= _MOST_WAITING:
                _drop_oldest(self._waiting)
            self._waiting[stranger] = self._loop.create_task(self._meet(stranger))

    async def _meet(self, stranger: socket.socket) -> None:
        """Make the handshake, and pass on who is listed."""
        outer = _Side()
        try:
            async with asyncio.timeout(_HANDSHAKE):
                await self._hello(stranger)
            # One in each round of the loop: hundreds at once must not hold up those inside.
            async with self._turn:
                await asyncio.sleep(0)
            if len(self._greeted) >= _MOST_GREETED:
                _drop_oldest(self._greeted)
            self._greeted[stranger] = self._waiting.pop(stranger)
            await self._loop.connect_accepted_socket(
                lambda: outer,
                stranger,
                ssl=self._server,
                ssl_handshake_timeout=_HANDSHAKE,
                ssl_shutdown_timeout=_HANDSHAKE,
            )
        except (OSError, TimeoutError) as problem:
            self._report(str(problem) or f"silent for {_HANDSHAKE:g} s")
            stranger.close()
            return
        except asyncio.CancelledError:
            stranger.close()
            raise
        finally:
            self._waiting.pop(stranger, None)
            self._greeted.pop(stranger, None)
        await self._let_in(outer)

    async def _hello(self, stranger: socket.socket) -> None:
        """Wait for a whole ClientHello: before it, a connection costs nothing but its socket.

        Raises OSError for what is none.
        """
        head = await self._peek(stranger, _HEADER)
        length = int.from_bytes(head[3:], "big")
        if head[0] != _HANDSHAKE_TYPE or length > _LARGEST:
            raise ConnectionError("sends no TLS")
        await self._peek(stranger, _HEADER + length)
        stranger.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, 1)

    async def _peek(self, stranger: socket.socket, count: int) -> bytes:
        """Wait for so many bytes, and return them; they stay to be read."""
        came = asyncio.Event()
        # Fewer do not wake the loop.
        stranger.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, count)
        self._loop.add_reader(stranger, came.set)
        try:
            await came.wait()
        finally:
            self._loop.remove_reader(stranger)
        found = stranger.recv(count, socket.MSG_PEEK)
        if len(found) < count:
            raise ConnectionError("left before its handshake")
        return found

    async def _let_in(self, outer: "_Side") -> None:
        certificate = outer.transport.get_extra_info("peercert")
        common = dict(pair for part in certificate["subject"] for pair in part)["commonName"]
        if self._keeps_out(common):
            await asyncio.sleep(_KEPT_WAITING)
        if reason := self._keeps_out(common):
            self._report(f"{common} {reason}")
            outer.transport.close()
            return
        name = self._names[common]
        self._coming[common] += 1
        try:
            async with asyncio.timeout(_REOPENING):
                inner, port = await self._to_router(self._context(name))
        except TimeoutError:
            outer.transport.close()
            return
        finally:
            self._coming[common] -= 1
        link = _Link(name, outer, inner, port, self._declared, self._links)
        expires = ssl.cert_time_to_seconds(certificate["notAfter"]) - time.time()
        link.until = self._loop.call_later(expires, link.end)
        if common not in self._names:  # revoked meanwhile
            link.end()

    async def _to_router(self, context: ssl.SSLContext) -> "tuple[_Side, int]":
        """Return a connection to the router, which may just be opened again, and its port."""
        inner = _Side()
        while True:
            port = self._port
            try:
                await self._loop.create_connection(lambda: inner, "127.0.0.1", port, ssl=context)
            except OSError:
                await asyncio.sleep(_AGAIN)
            else:
                return inner, port

    def _keeps_out(self, common: str) -> str:
        """Return the reason why a name may not come in now, empty if it may."""
        if common not in self._names:
            return "is not on the list of names"
        if self._declared.is_barred(common):
            return "was sent away a moment ago"
        links = self._coming[common]
        links += sum(link.name.common_name == common for link in self._links)
        return f"has {links} links" if links >= _MOST_LINKS else ""

    def _context(self, name: Name) -> ssl.SSLContext:
        """Return the settings of a link with the rights of a name's role and vehicles."""
        ours = member(name.role, name.vehicles, time.time() + _FOR_EVER)
        common = ours.common_name
        if common not in self._contexts:
            folder = self._folder / common
            self._authority.issue(ours, [], folder)
            context = ssl.create_default_context(cafile=self._folder / FLEET)
            context.load_cert_chain(folder / CERTIFICATE, folder / KEY)
            self._contexts[common] = context
        return self._contexts[common]

    def _report(self, problem: object) -> None:
        """Log the first failure, and at most every minute those since the last line."""
        self._failed += 1
        if (now := time.monotonic()) >= self._reported + _REPORTS:
            _log.warning("%d connections were sent away, the last: %s", self._failed, problem)
            self._failed, self._reported = 0, now


def _drop_oldest(strangers: _Strangers) -> None:
    if strangers:
        _, task = strangers.popitem(last=False)
        task.cancel()


class _Side(asyncio.Protocol):
    """One end of a link; it stops reading when the other end's buffer is full."""

    transport: asyncio.Transport
    other: "_Side"
    link: "_Link | None" = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.Transport", transport)
        self.transport.set_write_buffer_limits(high=_ROOM)
        self.transport.pause_reading()  # until there is a link

    def pause_writing(self) -> None:
        if self.link:
            self.other.transport.pause_reading()

    def resume_writing(self) -> None:
        if self.link:
            self.other.transport.resume_reading()

    def data_received(self, data: bytes) -> None:
        if self.link and self.link.permits(self, data):
            self.other.transport.write(data)

    def connection_lost(self, _error: Exception | None) -> None:
        if self.link:
            self.link.end()


class _Link:
    """Client's connection, and the one to Zenoh that stands for it."""

    until: asyncio.TimerHandle

    def __init__(
        self,
        name: Name,
        outer: _Side,
        inner: _Side,
        port: int,
        declared: "Budget",
        links: "set[_Link]",
    ) -> None:
        """Pass on data from now on; `declared` has the cost for each name."""
        self.name, self.outer, self.inner, self.port = name, outer, inner, port
        self._declared, self._links = declared, links
        # Only a hub, as a router, declares by the keys of the other end.
        self._theirs = Declarations() if name.role == "hub" else None
        self._declarations = Declarations(self._theirs)
        # A hub of all vehicles speaks for all who are behind it.
        self._limited = not (name.role == "hub" and EVERY in name.vehicles)
        links.add(self)
        outer.other, inner.other = inner, outer
        for side in (outer, inner):
            side.link = self
            side.transport.resume_reading()

    def permits(self, side: _Side, data: bytes) -> bool:
        """Count the declarations in a side's data; end the link if they are too many."""
        counted = self._declarations if side is self.outer else self._theirs
        if not self._limited or counted is None:
            return True
        before, why = self._declarations.cost, ""
        try:
            counted.feed(data)
        except MalformedBatch as problem:
            why = f"sends no Zenoh 1.x, or a packed form ({problem})"
        if not self._declared.spend(self.name, self._declarations.cost - before):
            why = "declares too many subscribers, queryables and tokens"
        if not self._declared.remember(self.name, self._declarations.asked):
            why = "has asked with too many wildcards"
        if why:
            self._declared.bar(self.name)
            _log.warning("%s %s: sent away", self.name.common_name, why)
            self.end()
        return not why

    def end(self) -> None:
        """Close both connections."""
        if self in self._links:
            self._links.discard(self)
            self.until.cancel()
            self._declared.spend(self.name, -self._declarations.cost)
            for side in (self.outer, self.inner):
                side.transport.abort()


class Budget:
    """Declarations of each name on all its links, and the names that have declared too many."""

    def __init__(self) -> None:
        self._spent: Counter[str] = Counter()
        self._asked: dict[str, set[bytes]] = {}
        self._barred: dict[str, float] = {}

    def spend(self, name: Name, cost: int) -> bool:
        """Add a cost, negative for what is withdrawn; return whether it is within the limit."""
        common = name.common_name
        self._spent[common] += cost
        return self._spent[common] <= _MOST_DECLARED * len(name.vehicles)

    def remember(self, name: Name, asked: set[bytes]) -> bool:
        """Add wildcards that were asked, and empty the set; return whether all are within the limit."""
        if not asked:
            return True
        known = self._asked.setdefault(name.common_name, set())
        known |= asked
        asked.clear()
        return len(known) <= _MOST_ASKED

    def bar(self, name: Name) -> None:
        """Keep a name out for the next seconds."""
        self._barred[name.common_name] = time.monotonic() + _BARRED

    def is_barred(self, common: str) -> bool:
        """Return whether the name is kept out now."""
        return time.monotonic() < self._barred.get(common, 0.0)


def _listener(endpoint: str) -> socket.socket:
    """Return a listening socket; raise UsageError for options, QuadctlError if it cannot be."""
    place = endpoint.partition("/")[2]
    host, _, port = place.rpartition(":")
    if not port.isdecimal():
        raise UsageError(f"{endpoint}: options of an endpoint are for quic only", "leave them out")
    try:
        family, *_, address = socket.getaddrinfo(
            host.strip("[]"), int(port), type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        both = host == "[::]" and socket.has_dualstack_ipv6()
        listener = socket.create_server(
            address[:2], family=family, backlog=_MOST_WAITING, dualstack_ipv6=both
        )
    except OSError as error:
        raise QuadctlError(
            f"{endpoint} cannot be opened: {error.strerror}",
            "is the port in use, or the address that of another machine?",
        ) from error
    listener.setblocking(False)
    # Inherited by its connections; asyncio overlooks sockets that name no protocol.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener
