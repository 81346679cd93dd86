"""Bad link: a TCP proxy to a hub that delays or holds data, or breaks connections."""

import asyncio
import random
import threading
from collections.abc import Coroutine
from pathlib import Path
from typing import Any, Self, TypeVar

T = TypeVar("T")

_WINDOW = 64
"""Pieces in transit on a link; beyond that the sender waits, as for a full pipe."""
_PIECE = 16_384
_RESENT = 0.3
"""Seconds until a lost piece is sent again."""


class Proxy:
    """Proxy on a free loopback port; `endpoint` is the hub's address through it.

    Data is forwarded both ways after `delay` s. The share `lost` takes longer, and so does all data
    behind it, as in TCP. After `cut` nothing is forwarded, as with an unplugged cable: data in
    transit waits, and so do new connections.
    """

    def __init__(self, hub: Path, delay: float = 0.0, lost: float = 0.0) -> None:
        self._hub, self._delay, self._lost = hub, delay, lost
        self._draw = random.Random(0)
        self._loop = asyncio.new_event_loop()
        self._links: set[asyncio.Task[None]] = set()
        self._thread = threading.Thread(target=self._loop.run_forever)

    def __enter__(self) -> Self:
        self._thread.start()
        self._whole = asyncio.Event()
        self._whole.set()
        self._server = self._do(asyncio.start_server(self._link, "127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._server.sockets[0].getsockname()[1]}"
        return self

    def __exit__(self, *_: object) -> None:
        self._do(self._close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def cut(self) -> None:
        """Hold all data from now on."""
        self._loop.call_soon_threadsafe(self._whole.clear)

    def mend(self) -> None:
        """Forward the held data and all that follows."""
        self._loop.call_soon_threadsafe(self._whole.set)

    def sever(self) -> None:
        """Break every connection; new ones are accepted."""
        self._do(self._break_off())

    def _do(self, what: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(what, self._loop).result(10)

    async def _close(self) -> None:
        self._server.close()
        await self._break_off()

    async def _break_off(self) -> None:
        links = list(self._links)
        for link in links:
            link.cancel()
        await asyncio.gather(*links, return_exceptions=True)

    async def _link(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._links.add(task)
        ends = [writer]
        try:
            await self._whole.wait()
            from_hub, to_hub = await asyncio.open_unix_connection(str(self._hub))
            ends.append(to_hub)
            async with asyncio.TaskGroup() as both:
                both.create_task(self._pass_on(reader, to_hub))
                both.create_task(self._pass_on(from_hub, writer))
        except* (OSError, asyncio.CancelledError):
            pass
        finally:
            self._links.discard(task)
            for end in ends:
                end.transport.abort()

    async def _pass_on(self, source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
        under_way: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(_WINDOW)

        async def take() -> None:
            piece = b"."
            while piece:
                piece = await source.read(_PIECE)
                again = _RESENT if self._draw.random() < self._lost else 0.0
                await under_way.put((self._loop.time() + self._delay + again, piece))

        taking = asyncio.create_task(take())
        try:
            while True:
                due, piece = await under_way.get()
                await asyncio.sleep(due - self._loop.time())
                await self._whole.wait()
                if not piece:
                    raise ConnectionResetError
                target.write(piece)
                await target.drain()
        finally:
            taking.cancel()
            await asyncio.gather(taking, return_exceptions=True)
