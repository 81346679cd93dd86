"""The command that has started the recorder: it is told how far that is, on stdout."""

import contextlib
import os
import threading

import msgspec

from services.runtime.errors import QuadctlError
from services.runtime.node import Node


class Attendant:
    """Reads one JSON document a line; the recorder ends, with a whole file, when its stdin does."""

    def __init__(self, node: Node) -> None:
        self._node = node
        # Who does not read what is told must not keep the recorder waiting.
        os.set_blocking(1, False)
        threading.Thread(target=self._watch, daemon=True).start()

    def tell(self, facts: dict[str, object]) -> None:
        """Say how far it is; who is gone, or frozen, is not told."""
        with contextlib.suppress(BrokenPipeError, BlockingIOError):
            os.write(1, msgspec.json.encode(facts) + b"\n")

    def tell_failure(self, problem: QuadctlError) -> None:
        """Say why it has ended."""
        said = {"code": problem.code, "message": problem.message, "hint": problem.hint}
        self.tell({"state": "failed", **said})

    def _watch(self) -> None:
        # The attendant holds the other end: it is closed however that one ends.
        while os.read(0, 1 << 10):
            pass
        self._node.loop.stop()
