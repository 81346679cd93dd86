"""All that comes on some keys, undecoded, kept until somebody has the time for it."""

import contextlib
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import zenoh

from services.runtime.bus import foreign, roster
from services.runtime.bus.breaks import Breaks
from services.runtime.errors import TimedOut

_MOST_BYTES = 256 << 20
"""Payloads that may wait; beyond, what comes is lost, and counted."""


_SETTLE = 0.5
"""Seconds that the hub has for that."""


class Taken(NamedTuple):
    """A message as it came: `at` that Unix time, and `published` at that one by its sender, ns."""

    key: str
    payload: bytes
    encoding: str
    at: int
    published: int


class Tap:
    """Hears keys or key expressions from when it is made; a message once, however many match it.

    Zenoh's thread does no more than copy a message. `lost` counts those for which there was
    no room. Times are those of one clock, which does not jump when that of the machine is set.
    """

    def __init__(self, session: zenoh.Session, keys: tuple[str, ...]) -> None:
        """Returns once the hub knows of it; raises TimedOut where that does not answer."""
        self.lost = 0
        self._session, self._breaks = session, Breaks(session)
        self._epoch = time.time_ns() - time.monotonic_ns()
        self._waiting: deque[Taken] = deque()
        # Each counted by one thread alone, so that nothing need be locked.
        self._came = self._went = 0
        self._patterns = [zenoh.KeyExpr(key) for key in keys]
        self._subscribers = [
            session.declare_subscriber(
                pattern,
                zenoh.handlers.Callback(self._taker(self._patterns[:count]), indirect=False),
            )
            for count, pattern in enumerate(self._patterns)
        ]
        roster.nodes(session, "*")

    def ask(self, key: str) -> None:
        """Have what latched topics hold come as well, where it is listened to."""
        callback = zenoh.handlers.Callback(self._on_reply, indirect=False)
        target, consolidation = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
        self._session.get(key, callback, target=target, consolidation=consolidation, timeout=1.0)

    def has_held(self) -> bool:
        """Whether the hub is there, and was so since this was last asked.

        One that is gone is waited for, and one that is back heard.
        """
        return not self._breaks.any() and bool(self._session.info.routers_zid())

    @property
    def waiting(self) -> int:
        """How many messages have come that are not yet taken."""
        return len(self._waiting)

    def settle(self) -> None:
        """Return once all has come that the hub had for us; where it does not answer, at once."""
        with contextlib.suppress(TimedOut):
            roster.nodes(self._session, "*", _SETTLE)

    def take(self, most: int) -> list[Taken]:
        """The messages that wait, in the order in which they came, up to so many."""
        taken = [self._waiting.popleft() for _ in range(min(most, len(self._waiting)))]
        self._went += sum(len(message.payload) for message in taken)
        return taken

    def _taker(self, others: list[zenoh.KeyExpr]) -> Callable[[zenoh.Sample], None]:
        """What takes a message, unless one of the other patterns brings it too."""

        def on_sample(sample: zenoh.Sample) -> None:
            foreign.stay()
            if not any(other.intersects(sample.key_expr) for other in others):
                self._put(sample)

        return on_sample

    def _on_reply(self, reply: zenoh.Reply) -> None:
        foreign.stay()
        sample = reply.ok
        if sample and any(pattern.intersects(sample.key_expr) for pattern in self._patterns):
            self._put(sample)

    def _put(self, sample: zenoh.Sample) -> None:
        if self._came - self._went > _MOST_BYTES:
            self.lost += 1
            return
        # Copied at once, as in a Subscription.
        payload, stamp = sample.payload.to_bytes(), sample.timestamp
        self._came += len(payload)
        at = self._epoch + time.monotonic_ns()
        published = at if stamp is None else round(stamp.get_time().timestamp() * 1e9)
        self._waiting.append(
            Taken(str(sample.key_expr), payload, str(sample.encoding), at, published)
        )
