"""What came on one key while somebody listened: how often, from whom, and how old."""

from collections import deque
from typing import Any

import msgspec

_KEPT = 32


class Heard:
    """The messages of a key, counted; `now` is monotonic, `age` by the sender's own stamp, both s."""

    def __init__(self) -> None:
        self.count = 0
        self.age = 0.0
        self.newest: deque[bytes] = deque(maxlen=_KEPT)
        """The last payloads, the newest last."""
        self._first = self._last = 0.0
        self._payloads = (b"", b"")
        self._sources: dict[str, tuple[float, float]] = {}

    def take(self, now: float, payload: bytes, source: str, age: float) -> None:
        """One more message; `source` is the session that stamped it, empty where none has."""
        if not self.count:
            self._first, self._payloads = now, (payload, payload)
        self.count, self._last = self.count + 1, now
        self._payloads = (self._payloads[0], payload)
        self.newest.append(payload)
        if source:
            began, _ = self._sources.get(source, (now, now))
            self._sources[source] = (began, now)
            self.age = max(self.age, age, key=abs)

    @property
    def hz(self) -> float:
        """Messages per second, 0 for fewer than two."""
        return (self.count - 1) / self._span if self.count > 1 and self._span else 0.0

    @property
    def pace(self) -> float:
        """Simulated seconds per second, by the messages' `stamp`; 0 where they tell none."""
        first, last = map(_stamp, self._payloads)
        if first is None or last is None or not self._span:
            return 0.0
        return max(last - first, 0.0) / self._span

    @property
    def publishers(self) -> int:
        """How many published at the same time; one that took another's place does not count."""
        spans = self._sources.values()
        return max(
            (sum(a <= end and begin <= b for a, b in spans) for begin, end in spans), default=0
        )

    @property
    def _span(self) -> float:
        return self._last - self._first


def _stamp(payload: bytes) -> float | None:
    try:
        message: Any = msgspec.msgpack.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    stamp = message.get("stamp") if isinstance(message, dict) else None
    return stamp if isinstance(stamp, float) else None
