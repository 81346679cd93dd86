"""Where a loop waits: for what is posted to it, or for a time."""

import time
from collections.abc import Callable
from queue import Empty, SimpleQueue

Item = Callable[[], None]

LOOK_UP = 0.5
"""An untimed wait can miss a signal, so even an endless one looks up now and then, s."""


class Inbox:
    """That of a loop which has its thread for itself."""

    def __init__(self) -> None:
        self._items: SimpleQueue[Item] = SimpleQueue()

    def __len__(self) -> int:
        return self._items.qsize()

    def put(self, item: Item) -> None:
        """Post something; safe to call from any thread and from a signal handler."""
        self._items.put(item)

    def next(self) -> Item | None:
        """What waits, without waiting for it; None where nothing does."""
        try:
            return self._items.get_nowait()
        except Empty:
            return None

    def wait(self, deadline: float) -> Item | None:
        """What comes until then (monotonic s); None where nothing does, or for no reason at all."""
        left = deadline - time.monotonic()
        if left <= 0:
            return self.next()
        try:
            return self._items.get(timeout=min(LOOK_UP, left))
        except Empty:
            return None
