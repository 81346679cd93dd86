"""Watcher of liveliness tokens on bare Zenoh: `watcher.py ENDPOINT PATTERN`."""

import sys
import threading
import time

import zenoh

from benchmarks.raw.session import opened
from benchmarks.worker import serve

_LONGEST = 5.0


class Watcher:
    """Current tokens, and the time at which the last of them went."""

    def __init__(self) -> None:
        self._there: set[str] = set()
        self._gone_at = 0.0
        self._changed = threading.Condition()

    def on_sample(self, sample: zenoh.Sample) -> None:
        """Add or remove a token."""
        with self._changed:
            key = str(sample.key_expr)
            if sample.kind == zenoh.SampleKind.PUT:
                self._there.add(key)
            else:
                self._there.discard(key)
                if not self._there:
                    self._gone_at = time.monotonic()
            self._changed.notify_all()

    def count(self) -> int:
        """Return the number of tokens."""
        with self._changed:
            return len(self._there)

    def gone(self, since: float) -> float:
        """Return the seconds from `since` (monotonic clock) until no token was left."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._gone_at > since, _LONGEST):
                raise TimeoutError(f"still listed: {sorted(self._there)}")
            return self._gone_at - since


if __name__ == "__main__":
    endpoint, pattern = sys.argv[1:]
    watcher, session = Watcher(), opened(endpoint)
    subscriber = session.liveliness().declare_subscriber(pattern, watcher.on_sample, history=True)
    serve(count=watcher.count, gone=watcher.gone, watched=lambda: str(subscriber.key_expr))
