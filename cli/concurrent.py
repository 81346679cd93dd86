"""Questions to several nodes at once, and paced sending."""

import threading
import time
from collections.abc import Callable, Collection
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from msgspec import Struct

from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import QuadctlError, TimedOut


class Pace:
    """What is sent to a hub that is gone is lost, and nobody else would say so: so it is asked.

    Twice within the client's timeout, so that its loss is told by then, however long a rest is.
    """

    def __init__(self, client: Client) -> None:
        """It counts from now."""
        self._client, self._asked = client, time.monotonic()

    def rest(self, until: float) -> None:
        """Sleep until a time (monotonic s); raises what `ask` does, as soon as it is due."""
        half = self._client.timeout / 2
        while (now := time.monotonic()) < until or now > self._asked + half:
            time.sleep(max(min(until, self._asked + half) - now, 0))
            if time.monotonic() > self._asked + half:
                self.ask()

    def ask(self) -> None:
        """Hear of the hub that it has all that was sent; raises as Client.flush."""
        # What is left of the timeout since it was asked last; if we were late ourselves, half of it.
        left = self._asked + self._client.timeout - time.monotonic()
        self._client.flush(max(left, self._client.timeout / 2))
        self._asked = time.monotonic()


T = TypeVar("T")


class Answers(Struct, Generic[T], frozen=True):
    """What came of each node: its answer, or why there is none."""

    answers: dict[str, T]
    problems: dict[str, QuadctlError]

    def fail(self) -> None:
        """Raise the first problem, where there is one, and the others with it."""
        if not self.problems:
            return
        first, *others = self.problems.values()
        first.others = [other.message for other in others]
        raise first


def ask_each(
    nodes: Collection[str],
    ask: Callable[[str], T],
    within: float | None = None,
    *,
    all_or_none: bool = False,
) -> Answers[T]:
    """Call `ask` for every node, where there are several each on a thread of its own.

    With `within` (s), who takes longer is not waited for, and is told as TimedOut. With
    `all_or_none` nobody is waited for once one has failed: of the others nothing is told then.
    """
    answers: dict[str, T] = {}
    problems: dict[str, QuadctlError] = {}
    faults: list[Exception] = []
    done: SimpleQueue[str] = SimpleQueue()

    def one(node: str) -> None:
        try:
            answers[node] = ask(node)
        except QuadctlError as problem:
            problems[node] = problem
        except Exception as fault:  # noqa: BLE001 - raised again below, where it can be told
            faults.append(fault)
        finally:
            done.put(node)

    if len(nodes) == 1 and within is None:
        one(*nodes)
    else:
        ends = None if within is None else time.monotonic() + within
        threads = [threading.Thread(target=one, args=(node,), daemon=True) for node in nodes]
        for thread in threads:
            thread.start()
        late = set(nodes)
        while late and not (all_or_none and problems):
            try:
                left = None if ends is None else max(ends - time.monotonic(), 0)
                late.remove(done.get(timeout=left))
            except Empty:
                for node in late:
                    problems[node] = TimedOut(
                        f"there was no answer within {within:g} s",
                        "`quadctl status` shows who is frozen",
                    )
                break
    if faults:
        raise faults[0]
    # In the order asked for, whoever was quicker; whoever answers from now on was too late.
    return Answers(
        {node: answers[node] for node in nodes if node in answers and node not in problems},
        {node: problems[node] for node in nodes if node in problems},
    )
