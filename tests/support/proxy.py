"""A bad link: a TCP proxy to a hub that delays what passes, stops passing it, or breaks off."""

import asyncio
import random
import threading
from collections.abc import Coroutine
from pathlib import Path
from typing import Any, Self, TypeVar

T = TypeVar("T")

_WINDOW = 64
"""Pieces under way on a link; beyond, its sender has to wait, as for a full pipe."""
_PIECE = 16_384
_RESENT = 0.3
"""Seconds after which what was lost is sent again."""


class Proxy:
    """Listens on a free port of the loopback interface; `endpoint` is that of the hub behind it.

    Both ways what comes is passed on `delay` s later; of what is `lost`, a share of all, it takes
    longer, and so it does of all that comes behind it, as TCP has it. While it is `cut` nothing is, as with a cable
    pulled out: what is under way waits, and so does who connects.
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
        """Nothing passes from now on."""
        self._loop.call_soon_threadsafe(self._whole.clear)

    def mend(self) -> None:
        """What has waited passes, and all that comes."""
        self._loop.call_soon_threadsafe(self._whole.set)

    def sever(self) -> None:
        """Break off every connection; new ones are let in."""
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
