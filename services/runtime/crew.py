"""The services of one process, one a vehicle: each has a loop, and a thread, of its own."""

import threading
from collections.abc import Callable

from services.runtime.loop import Loop


class Crew:
    """They live and die together: when one ends, by itself or by an error, all do."""

    def __init__(self) -> None:
        self._runs: list[tuple[str, Callable[[], None]]] = []
        self._loops: list[Loop] = []
        self._errors: list[BaseException] = []

    def take(self, name: str, loop: Loop, run: Callable[[], None]) -> None:
        """Add one; `run` is to return when its loop is stopped."""
        self._runs.append((name, run))
        self._loops.append(loop)

    def stop(self) -> None:
        """Have all of them end soon; safe to call from a signal handler."""
        for loop in self._loops:
            loop.stop()

    def run(self) -> None:
        """Run all until they have ended; raises what one of them raised."""
        if len(self._runs) == 1:
            self._runs[0][1]()
            return
        threads = [
            threading.Thread(target=self._run, args=(run,), name=name, daemon=True)
            for name, run in self._runs
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        if self._errors:
            raise self._errors[0]

    def _run(self, run: Callable[[], None]) -> None:
        try:
            run()
        except BaseException as error:  # noqa: BLE001 - raised again on the main thread
            self._errors.append(error)
        finally:
            self.stop()
