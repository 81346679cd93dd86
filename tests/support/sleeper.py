"""Measurement of this machine's stalls, beside a test that flies in real time."""

import os
import threading
import time

HICCUP = 0.05
"""Delay (s) of a wake-up that counts as a stall of the machine."""
_NAP = 0.01


class Sleeper:
    """Threads that only sleep, one on each processor, and measure their delays.

    A stall may hit one processor alone, and with it each process that waits for its turn there.
    """

    def __init__(self) -> None:
        self._stalls: list[tuple[float, float]] = []
        self._done = threading.Event()
        processors = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else {None}
        self._threads = [
            threading.Thread(target=self._sleep, args=(each,), daemon=True) for each in processors
        ]
        for thread in self._threads:
            thread.start()

    def _sleep(self, processor: int | None) -> None:
        if processor is not None:
            os.sched_setaffinity(0, {processor})  # of this thread alone
        while not self._done.is_set():
            before = time.monotonic()
            time.sleep(_NAP)
            now = time.monotonic()
            if now - before > _NAP + HICCUP:
                self._stalls.append((before, now))

    def within(self, begin: float, end: float) -> float:
        """Return the seconds between two times, monotonic s, in which a processor stalled."""
        stalled, since = 0.0, begin
        for start, stop in sorted(self._stalls):
            stalled += max(min(stop, end) - max(start, since), 0.0)
            since = max(since, stop)
        return stalled

    def stop(self) -> str:
        """Stop the threads, and return a summary."""
        self._done.set()
        for thread in self._threads:
            thread.join()
        seen = [end - begin for begin, end in self._stalls]
        worst = f", for {1000 * max(seen):.0f} ms at most" if seen else ""
        return f"a processor stalled {len(seen)} times for over {1000 * HICCUP:.0f} ms{worst}"
