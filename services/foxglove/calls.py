"""Order of the calls of clients. Pure.

The SDK runs the handler of each call on a thread of its own, so that two calls sent back to back
may reach us in either order. Their ids show it: every client counts its calls by one.
"""

from collections.abc import Iterable
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T")

PATIENCE = 0.05
"""Seconds that a call waits for those with lower ids; a thread of the SDK starts within a few ms."""


class _Waiting(NamedTuple):
    client: int
    number: int
    since: float


class CallOrder(Generic[T]):
    """Calls that wait for their turn; those of one client leave in the order of their ids."""

    def __init__(self) -> None:
        self._items: dict[_Waiting, T] = {}
        self._last: dict[int, int] = {}

    def __len__(self) -> int:
        return len(self._items)

    def add(self, client: int, number: int, item: T, now: float) -> None:
        """Add the call with this id of a client at a time (s)."""
        self._items[_Waiting(client, number, now)] = item

    def next(self, now: float) -> T | None:
        """Remove and return the next call whose turn it is at a time (s), if any."""
        for each in sorted(self._turns(), key=lambda waiting: waiting.since):
            if now >= self._due(each):
                last = self._last.get(each.client, each.number)
                self._last[each.client] = max(last, each.number)
                return self._items.pop(each)
        return None

    def due(self) -> float | None:
        """Return the time (s) at which `next` will have a call, None without any."""
        return min(map(self._due, self._turns()), default=None)

    def _turns(self) -> Iterable[_Waiting]:
        """Return the waiting call of each client with the lowest id."""
        lowest: dict[int, _Waiting] = {}
        for each in self._items:
            known = lowest.get(each.client)
            if known is None or each.number < known.number:
                lowest[each.client] = each
        return lowest.values()

    def _due(self, each: _Waiting) -> float:
        last = self._last.get(each.client)
        follows = last is not None and each.number <= last + 1
        return each.since if follows else each.since + PATIENCE
