"""Measurement of this machine's stalls, beside a test that flies in real time."""

import threading
import time

HICCUP = 0.05
"""Delay (s) of a wake-up that counts as a stall of the machine."""
_NAP = 0.01


class Sleeper:
    """Thread that only sleeps, and measures its delays."""

    def __init__(self) -> None:
        self._stalls: list[tuple[float, float]] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._sleep, daemon=True)
        self._thread.start()

    def _sleep(self) -> None:
        while not self._done.is_set():
            before = time.monotonic()
            self._done.wait(_NAP)
            now = time.monotonic()
            if now - before > _NAP + HICCUP:
                self._stalls.append((before, now))

    def within(self, begin: float, end: float) -> float:
        """Return the seconds of stall between two times, monotonic s."""
        return sum(max(min(b, end) - max(a, begin), 0.0) for a, b in self._stalls)

    def stop(self) -> str:
        """Stop the thread, and return a summary."""
        self._done.set()
        self._thread.join()
        seen = [end - begin for begin, end in self._stalls]
        worst = f", for {1000 * max(seen):.0f} ms at most" if seen else ""
        return f"the machine stalled {len(seen)} times for over {1000 * HICCUP:.0f} ms{worst}"
