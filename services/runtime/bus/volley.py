"""Many messages and queries at once, whatever is in them; what comes back is counted."""

import threading
from collections import Counter
from typing import Any

from services.runtime.bus import codec
from services.runtime.bus.client import Client
from services.runtime.errors import QuadctlError

_MOST = 64
"""Queries that are under way at a time."""


class Volley:
    """Counts the replies: `taken` names the keys of those that are no errors."""

    def __init__(self, client: Client) -> None:
        self.codes: Counter[str] = Counter()
        """How many error replies there were of each code."""
        self.taken: list[str] = []
        self.published = self.asked = 0
        self._client = client
        self._room = threading.Semaphore(_MOST)
        self._lock = threading.Lock()

    @property
    def answered(self) -> int:
        """How many queries have had a reply."""
        return sum(self.codes.values()) + len(self.taken)

    def publish(self, key: str, data: bytes, encoding: str) -> None:
        """Say it on a key."""
        self.published += 1
        self._client.session.put(key, data, encoding=encoding)

    def ask(self, key: str, data: bytes, encoding: str, attachment: bytes | None) -> bool:
        """Ask a service; False where none of those asked before has answered in time."""
        if not self._room.acquire(timeout=self._client.timeout):
            return False
        self.asked += 1
        self._client.session.get(
            key,
            lambda reply: self._on_reply(key, reply),
            payload=data,
            encoding=encoding,
            attachment=attachment,
            timeout=self._client.timeout,
        )
        return True

    def settle(self) -> None:
        """Wait for the replies that are yet to come, as long as each may take."""
        for _ in range(_MOST):
            if not self._room.acquire(timeout=self._client.timeout):
                return
        self._room.release(_MOST)

    def _on_reply(self, key: str, reply: Any) -> None:
        with self._lock:
            if reply.ok is not None:
                self.taken.append(key)
            else:
                self.codes[_code(reply.err)] += 1
        self._room.release()


def _code(error: Any) -> str:
    if str(error.encoding) != codec.ERROR_ENCODING:
        return "no answer"
    problem: QuadctlError = codec.decode_error(error.payload.to_bytes())
    return problem.code
