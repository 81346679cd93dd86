"""The process that flies a campaign, from the command's side: an order in, documents out."""

import subprocess
import sys
from collections.abc import Iterator
from typing import Any, Self

import msgspec

from services.runtime.errors import QuadctlError

_COMMAND = (sys.executable, "-P", "-m", "services.campaign")
_END = 5.0


class Running:
    """A campaign under way; it ends where this does."""

    def __init__(self, order: dict[str, Any]) -> None:
        self.report: dict[str, Any] = {}
        # In a session of its own: Ctrl-C is ours to hear. It ends when its stdin does.
        self._popen = subprocess.Popen(
            _COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        assert self._popen.stdin is not None  # noqa: S101 - a pipe, as asked for above
        self._popen.stdin.write(msgspec.json.encode(order) + b"\n")
        self._popen.stdin.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._popen.stdin is not None  # noqa: S101 - a pipe, as asked for above
        self._popen.stdin.close()
        try:
            self._popen.wait(_END)
        except subprocess.TimeoutExpired:
            self._popen.kill()

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """What it says on the way; raises QuadctlError where it fails."""
        assert self._popen.stdout is not None  # noqa: S101 - a pipe, as asked for above
        for line in self._popen.stdout:
            said: dict[str, Any] = msgspec.json.decode(line)
            if "error" in said:
                raise QuadctlError(**said["error"])
            if "report" in said:
                self.report = said["report"]
                return
            yield said
        raise QuadctlError(
            f"the campaign's process ended with code {self._popen.wait()}", "see the lines above"
        )
