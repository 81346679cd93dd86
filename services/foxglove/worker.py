"""Thread that executes what clients request, one after the other: calls of our services block."""

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import TypeVar

from quadctl.services.foxglove.calls import CallOrder
from quadctl.services.runtime.errors import Refused

T = TypeVar("T")

_MOST_WAITING = 64
"""Calls and other jobs that may wait; beyond, they are refused."""


class CallWorker:
    """Thread with a queue; safe to use from any thread, and raises Refused if the queue is full."""

    def __init__(self) -> None:
        self._change = threading.Condition()
        self._jobs: deque[Callable[[], None]] = deque()
        self._calls: CallOrder[Callable[[], None]] = CallOrder()
        threading.Thread(target=self._work, daemon=True).start()

    def submit(self, job: Callable[[], T]) -> "Future[T]":
        """Execute a job soon; return its future result."""
        done: Future[T] = Future()
        with self._change:
            self._check_room()
            self._jobs.append(partial(_fulfil, done, job))
            self._change.notify()
        return done

    def call(self, client: int, number: int, job: Callable[[], T]) -> T:
        """Execute a client's call in the order of its numbers, and return its result."""
        done: Future[T] = Future()
        with self._change:
            self._check_room()
            self._calls.add(client, number, partial(_fulfil, done, job), time.monotonic())
            self._change.notify()
        return done.result()

    def _check_room(self) -> None:
        if len(self._jobs) + len(self._calls) >= _MOST_WAITING:
            raise Refused("too many calls wait", "call again later")

    def _work(self) -> None:
        while True:
            self._next()()

    def _next(self) -> Callable[[], None]:
        """Wait for the next job."""
        with self._change:
            while True:
                if (call := self._calls.next(time.monotonic())) is not None:
                    return call
                if self._jobs:
                    return self._jobs.popleft()
                due = self._calls.due()
                self._change.wait(None if due is None else max(due - time.monotonic(), 0))


def _fulfil(done: "Future[T]", job: Callable[[], T]) -> None:
    """Execute a job; a fault in it must not end all later ones."""
    try:
        done.set_result(job())
    except Exception as problem:  # noqa: BLE001 - raised again where the result is wanted
        done.set_exception(problem)
