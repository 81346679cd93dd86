"""Strangers at a TLS listener: many connections that never complete a handshake."""

import itertools
import ssl
import threading
import time
from collections import deque
from contextlib import AbstractContextManager
from socket import socket
from types import TracebackType
from typing import Self


def client_hello() -> bytes:
    """Return the first message of a TLS handshake, whole."""
    context = ssl.create_default_context()
    outgoing = ssl.MemoryBIO()
    half = context.wrap_bio(ssl.MemoryBIO(), outgoing, server_hostname="stranger")
    try:
        half.do_handshake()
    except ssl.SSLWantReadError:
        return outgoing.read()
    raise AssertionError


class Strangers(AbstractContextManager["Strangers"]):
    """A number of half-open connections to a loopback port, with new ones each second.

    They come from 250 addresses; a third of them send a `hello`, else a whole ClientHello. One that the listener
    closes is replaced at once.
    """

    def __init__(self, port: int, count: int, new: float, hello: bytes = b"") -> None:
        """Hold `count` connections, and open `new` more each second in place of the oldest."""
        self._port, self._count, self._new = port, count, new
        self._open: deque[socket] = deque()
        self._numbers = itertools.count()
        self._hello = hello or client_hello()
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.made = 0
        """Connections so far."""

    def __enter__(self) -> Self:
        for _ in range(self._count):
            self._come()
        self._thread.start()
        return self

    def __exit__(
        self, _1: type[BaseException] | None, _2: BaseException | None, _3: TracebackType | None
    ) -> None:
        self._ends.set()
        self._thread.join()
        while self._open:
            self._open.popleft().close()

    def _come(self) -> None:
        number = next(self._numbers)
        made = socket()
        made.bind((f"127.9.0.{1 + number % 250}", 0))
        made.setblocking(False)
        made.connect_ex(("127.0.0.1", self._port))
        if number % 3 == 0:
            made.setblocking(True)
            made.sendall(self._hello)
            made.setblocking(False)
        self._open.append(made)
        self.made += 1

    def _run(self) -> None:
        began = time.monotonic()
        for number in itertools.count(1):
            if self._ends.wait(max(0.0, began + number / self._new - time.monotonic())):
                return
            for _ in range(len(self._open)):
                stranger = self._open.popleft()
                if _is_open(stranger):
                    self._open.append(stranger)
                else:
                    stranger.close()
            while len(self._open) < self._count:
                self._come()
            self._open.popleft().close()
            self._come()


def _is_open(stranger: socket) -> bool:
    try:
        return stranger.recv(4096) != b""
    except BlockingIOError:
        return True
    except OSError:
        return False
