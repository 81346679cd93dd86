"""Radio link between a vehicle and programs that speak MAVLink: all hear it, with loss and delay."""

import heapq
import random
import selectors
import socket
import threading
import time
from itertools import count
from typing import Any, Self


class Relay:
    """Relay of datagrams: what comes to `port` goes to all listeners, what they send goes back.

    `loss` is the share of packets lost, `delay` and `jitter` are seconds, each way, of the first
    listener alone; the others are the vehicle's own cables.
    """

    def __init__(
        self, *listeners: int, loss: float = 0.0, delay: float = 0.0, jitter: float = 0.0
    ) -> None:
        self.loss, self.delay, self.jitter = loss, delay, jitter
        self._draws = random.Random(7)
        self._vehicle = _socket()
        self.port: int = self._vehicle.getsockname()[1]
        self._from: Any = None
        self._listeners = {_socket(): ("127.0.0.1", port) for port in listeners}
        self._radio = next(iter(self._listeners))
        self._waiting: list[tuple[float, int, socket.socket, bytes, Any]] = []
        self._numbers, self._is_closed = count(), False
        self.passed = self.lost = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._is_closed = True
        self._thread.join()
        for each in (self._vehicle, *self._listeners):
            each.close()

    def _run(self) -> None:
        with selectors.DefaultSelector() as ready:
            for each in (self._vehicle, *self._listeners):
                ready.register(each, selectors.EVENT_READ)
            while not self._is_closed:
                left = self._waiting[0][0] - time.monotonic() if self._waiting else 0.1
                for key, _ in ready.select(max(min(left, 0.1), 0.0)):
                    self._take(key.fileobj)
                while self._waiting and self._waiting[0][0] <= time.monotonic():
                    _, _, by, data, to = heapq.heappop(self._waiting)
                    by.sendto(data, to)

    def _take(self, by: Any) -> None:
        try:
            data, address = by.recvfrom(65_536)
        except OSError:  # nobody listens there now
            return
        if by is self._vehicle:
            self._from = address
            for listener, port in self._listeners.items():
                self._pass(listener, data, port, radio=listener is self._radio)
        elif self._from is not None:
            self._pass(self._vehicle, data, self._from, radio=by is self._radio)

    def _pass(self, by: socket.socket, data: bytes, to: Any, *, radio: bool) -> None:
        later = 0.0
        if radio:
            self.passed += 1
            if self._draws.random() < self.loss:
                self.lost += 1
                return
            later = max(self._draws.gauss(self.delay, self.jitter), 0.0)
        item = time.monotonic() + later, next(self._numbers), by, data, to
        heapq.heappush(self._waiting, item)


def _socket() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    return made
