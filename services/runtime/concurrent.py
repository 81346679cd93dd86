"""Calls to several nodes at once."""

import threading
import time
from collections.abc import Callable, Collection
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from msgspec import Struct

from quadctl.services.runtime.errors import QuadctlError

T = TypeVar("T")


class Answers(Struct, Generic[T], frozen=True):
    """Answers of several nodes, and the error of each node without one."""

    answers: dict[str, T]
    problems: dict[str, QuadctlError]

    def fail(self) -> None:
        """Raise the first problem, if any, with the messages of the others attached."""
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
    """Call `ask` for every node; if there are several, each on a separate thread.

    A node that takes longer than `within` (s) is left out of the result. With `all_or_none` the
    first problem ends the wait, and so are the nodes that are still silent.
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
        except Exception as fault:  # noqa: BLE001 - raised again below, on the caller's thread
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
                break
    if faults:
        raise faults[0]
    # In the order of `nodes`; answers that arrive from now on are too late.
    return Answers(
        {node: answers[node] for node in nodes if node in answers and node not in problems},
        {node: problems[node] for node in nodes if node in problems},
    )
