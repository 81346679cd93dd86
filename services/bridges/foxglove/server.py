"""WebSocket server of the protocol of Foxglove.

One thread serves all clients by asyncio. What blocks is executed on the threads of each client's
RequestQueue.
"""

import asyncio
import logging
import secrets
import socket
import threading
from collections import deque
from collections.abc import Callable, Collection, Iterable
from concurrent.futures import Future
from functools import partial
from http import HTTPStatus
from itertools import count
from ssl import SSLContext

from websockets.asyncio.server import ServerConnection, serve
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from quadctl.services.bridges.foxglove.client import (
    Backend,
    Channel,
    FoxgloveClient,
    Log,
    Shared,
    token_of,
)
from quadctl.services.bridges.foxglove.protocol import (
    JSON,
    JSON_SCHEMA,
    SUBPROTOCOLS,
    Advertise,
    Advertised,
    AdvertiseServices,
    Document,
    Offered,
    ServerInfo,
    may_watch,
    message_frame,
)
from quadctl.services.runtime.errors import QuadctlError

_CAPABILITIES = [
    "clientPublish",
    "connectionGraph",
    "parameters",
    "parametersSubscribe",
    "services",
]
_MOST_CLIENTS = 50
"""Clients that may watch; as many may act, which watchers cannot keep out."""
_MOST_WAITING = 20_000
"""Messages that may wait for all clients; beyond, the oldest are lost."""
_MOST_BYTES = 1 << 20
"""Bytes of a request."""
_GRACE = 60.0
"""Seconds without an answer to a ping after which a client counts as gone."""

Message = tuple[Channel, bytes, int]
"""A channel, its message, and the Unix time (ns) at which it came."""


class FoxgloveServer:
    """Server for programs, and for the pages of some sites.

    A client may only watch unless its address has the token.
    """

    def __init__(self, backend: Backend, log: Log, *, token: str, origins: Collection[str]) -> None:
        """Take who answers requests, and the sites (e.g. http://lab:8080) whose pages may connect."""
        self._shared = Shared(backend, log, token)
        self._origins = origins
        self._session = secrets.token_hex(8)
        self._numbers = count(1)
        self._clients: set[FoxgloveClient] = set()
        self._outbox: deque[Message] = deque(maxlen=_MOST_WAITING)
        self._flushing = False

    def open(self, listening: socket.socket, tls: SSLContext | None) -> None:
        """Serve at a socket from now on."""
        serves: Future[None] = Future()
        work = partial(self._run, listening, tls, serves)
        threading.Thread(target=lambda: asyncio.run(work()), name="foxglove", daemon=True).start()
        serves.result()

    def channel(
        self, topic: str, name: str, schema: str, latest: Callable[[], Iterable[tuple[bytes, int]]]
    ) -> Channel:
        """Advertise a channel of JSON; from any thread. `name` and `schema` are of its messages."""
        advertised = Advertised(next(self._numbers), topic, JSON, name, schema, JSON_SCHEMA)
        channel = Channel(advertised, latest)
        self._loop.call_soon_threadsafe(self._advertise, channel)
        return channel

    def offer(self, services: Iterable[Callable[[int], Offered]]) -> None:
        """Offer services, each made from its number; from any thread."""
        made = [make(next(self._numbers)) for make in services]
        self._loop.call_soon_threadsafe(self._offer, made)

    def publish(self, messages: Iterable[Message]) -> None:
        """Send messages to the subscribers of their channels; from any thread."""
        self._outbox.extend(messages)
        if not self._flushing:
            # One wake for all that come until then.
            self._flushing = True
            self._loop.call_soon_threadsafe(self._flush)

    def refresh(self, what: str) -> None:
        """Read the `graph` or the `parameters` anew, if a client has subscribed; from any thread."""
        self._loop.call_soon_threadsafe(self._shared.mark_stale, what)

    async def _run(self, at: socket.socket, tls: SSLContext | None, serves: "Future[None]") -> None:
        self._loop = self._shared.loop = asyncio.get_running_loop()
        quiet = logging.getLogger("websockets.server")
        quiet.setLevel(logging.CRITICAL)  # it logs each client that comes, goes, or sends garbage
        try:
            listening = await serve(
                self._serve,
                sock=at,
                ssl=tls,
                subprotocols=[*map(Subprotocol, SUBPROTOCOLS)],
                process_request=self._why_not,
                compression=None,
                max_size=_MOST_BYTES,
                ping_timeout=_GRACE,
                logger=quiet,
            )
        except Exception as error:  # noqa: BLE001 - raised where the server is opened
            serves.set_exception(error)
            return
        async with listening:
            serves.set_result(None)
            while True:
                await self._shared.asked.wait()
                self._shared.asked.clear()
                try:
                    await self._refresh()
                except QuadctlError:
                    pass  # logged; the next change tries again
                except Exception:
                    self._shared.log.exception("a refresh failed")

    def _why_not(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the refusal of a connection, None to serve it."""
        origin = request.headers.get("Origin", "")
        if not may_watch(origin, self._origins):
            self._shared.log.warning("refused a page of %s: --origin allows it", origin)
            why = f"pages of {origin} may not connect to this bridge\n"
            return connection.respond(HTTPStatus.FORBIDDEN, why)
        acts = self._shared.is_right(token_of(request.path))
        if len([each for each in self._clients if each.controls is acts]) >= _MOST_CLIENTS:
            why = f"{_MOST_CLIENTS} clients are connected already\n"
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, why)
        return None

    async def _serve(self, connection: ServerConnection) -> None:
        client = FoxgloveClient(self._shared, connection)
        self._clients.add(client)
        try:
            client.tell(ServerInfo("quadctl", _CAPABILITIES, [JSON], self._session))
            channels = [each.advertised for each in self._shared.channels.values()]
            client.tell(Advertise(channels))
            client.tell(AdvertiseServices([*self._shared.services.values()]))
            await client.serve()
        except Exception:
            self._shared.log.exception("a client failed")
            raise
        finally:
            self._clients.remove(client)
            client.unsubscribe([*client.subscriptions])

    def _advertise(self, channel: Channel) -> None:
        self._shared.channels[channel.advertised.id] = channel
        self._tell_all(Advertise([channel.advertised]))

    def _offer(self, services: list[Offered]) -> None:
        self._shared.services |= {each.id: each for each in services}
        self._tell_all(AdvertiseServices(services))

    def _tell_all(self, document: Document) -> None:
        for client in self._clients:
            client.tell(document)

    def _flush(self) -> None:
        self._flushing = False
        # Those that come meanwhile have their own turn, after the requests of clients.
        for _ in range(len(self._outbox)):
            channel, data, at = self._outbox.popleft()
            for client, subscription in channel.subscribers.items():
                client.send(message_frame(subscription, at, data))

    async def _refresh(self) -> None:
        shared = self._shared
        stale, shared.stale = shared.stale, set()
        if "graph" in stale and any(client.graph is not None for client in self._clients):
            graph = await asyncio.to_thread(shared.tried, shared.backend.graph)
            for client in self._clients:
                client.show_graph(graph)
        if "parameters" in stale and any(client.watched for client in self._clients):
            values = await asyncio.to_thread(shared.tried, shared.backend.parameters, ())
            for client in self._clients:
                client.show_parameters(values)
