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
from typing import Any

from websockets.asyncio.server import ServerConnection, serve
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from quadctl.services.bridges.base import Log
from quadctl.services.bridges.foxglove.client import (
    Channel,
    FoxgloveClient,
    Host,
    Messages,
    token_of,
)
from quadctl.services.bridges.foxglove.protocol import JSON, SUBPROTOCOLS, may_watch, message_frame
from quadctl.services.bridges.foxglove.vehicles import Vehicles
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


class FoxgloveServer(Host):
    """Server for programs, and for the pages of some sites.

    A client may only watch unless its address has the token.
    """

    def __init__(
        self, vehicles: Vehicles, log: Log, *, token: str, origins: Collection[str]
    ) -> None:
        """Take the sites (e.g. http://lab:8080) whose pages may connect."""
        super().__init__(vehicles, log, token)
        self._origins, self._session = origins, secrets.token_hex(8)
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
        self, topic: str, schema: dict[str, str], latest: Callable[[], Messages] | None = None
    ) -> Channel:
        """Advertise a channel of JSON; from any thread. `schema` is that of its messages."""
        number = next(self._numbers)
        channel = Channel({"id": number, "topic": topic, "encoding": JSON, **schema}, latest)
        self.loop.call_soon_threadsafe(self._advertise, number, channel)
        return channel

    def offer(self, services: Iterable[dict[str, Any]]) -> None:
        """Offer services; from any thread."""
        offered = {(number := next(self._numbers)): {"id": number, **each} for each in services}
        self.loop.call_soon_threadsafe(self._offer, offered)

    def publish(self, messages: Iterable[Message]) -> None:
        """Send messages to the subscribers of their channels; from any thread."""
        self._outbox.extend(messages)
        if not self._flushing:
            # One wake for all that come until then.
            self._flushing = True
            self.loop.call_soon_threadsafe(self._flush)

    async def _run(self, at: socket.socket, tls: SSLContext | None, serves: "Future[None]") -> None:
        self.loop = asyncio.get_running_loop()
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
                await self._asked.wait()
                self._asked.clear()
                try:
                    await self._refresh()
                except QuadctlError:
                    pass  # logged; the next change tries again
                except Exception:
                    self.log.exception("a refresh failed")

    def _why_not(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the refusal of a connection, None to serve it."""
        origin = request.headers.get("Origin", "")
        if not may_watch(origin, self._origins):
            self.log.warning("refused a page of %s: --origin allows it", origin)
            why = f"pages of {origin} may not connect to this bridge\n"
            return connection.respond(HTTPStatus.FORBIDDEN, why)
        acts = self.why_watching(token_of(request.path)) is None
        if len([each for each in self._clients if each.controls is acts]) >= _MOST_CLIENTS:
            why = f"{_MOST_CLIENTS} clients are connected already\n"
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, why)
        return None

    async def _serve(self, connection: ServerConnection) -> None:
        client = FoxgloveClient(self, connection)
        self._clients.add(client)
        try:
            client.tell(
                "serverInfo", name="quadctl", capabilities=_CAPABILITIES,
                supportedEncodings=[JSON], sessionId=self._session,
            )  # fmt: skip
            channels = [each.advertised for each in self.channels.values()]
            client.tell("advertise", channels=channels)
            client.tell("advertiseServices", services=[*self.services.values()])
            await client.serve()
        except Exception:
            self.log.exception("a client failed")
            raise
        finally:
            self._clients.remove(client)
            client.unsubscribe([*client.subscriptions])

    def _advertise(self, number: int, channel: Channel) -> None:
        self.channels[number] = channel
        for client in self._clients:
            client.tell("advertise", channels=[channel.advertised])

    def _offer(self, services: dict[int, dict[str, Any]]) -> None:
        self.services |= services
        for client in self._clients:
            client.tell("advertiseServices", services=[*services.values()])

    def _flush(self) -> None:
        self._flushing = False
        # Those that come meanwhile have their own turn, after the requests of clients.
        for _ in range(len(self._outbox)):
            channel, data, at = self._outbox.popleft()
            for client, subscription in channel.subscribers.items():
                client.send(message_frame(subscription, at, data))

    async def _refresh(self) -> None:
        stale, self._stale = self._stale, set()
        if "graph" in stale and any(client.graph is not None for client in self._clients):
            graph = await asyncio.to_thread(self.tried, self.vehicles.graph)
            for client in self._clients:
                client.show_graph(graph)
        if "parameters" in stale and any(client.watched for client in self._clients):
            values = await asyncio.to_thread(self.tried, self.vehicles.parameters, ())
            for client in self._clients:
                client.show_parameters(values)
