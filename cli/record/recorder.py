"""The recorder's process, started by a command that shows how far it is."""

import contextlib
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import msgspec

from cli.options import Options
from services.runtime.errors import WIRE_ERRORS, QuadctlError

_PATIENCE = 10.0
"""Seconds that it may take to make its file whole."""


class Recorder:
    """Runs for as long as a `with` block lasts, and ends its file whole however that is left."""

    def __init__(
        self, options: Options, file: Path, keys: list[str], duration: float | None
    ) -> None:
        command = [sys.executable, "-P", "-m", "services.recorder", "--attended"]
        command += ["--realm", options.realm, "--vehicle", options.vehicle, "-o", str(file)]
        command += ["--connect", options.connect] if options.connect else []
        command += [word for key in keys for word in ("--key", key)]
        command += ["--duration", repr(duration)] if duration is not None else []
        self._file = file
        # In a session of its own: Ctrl-C is this command's to hear, and to pass on. With our end of
        # its stdin it also ends when we are killed.
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )

        self._limit = threading.Timer(_PATIENCE, self._process.kill)
        self._limit.daemon = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._limit.cancel()
        assert self._process.stdin is not None  # noqa: S101 - a pipe, as asked for above
        self._process.stdin.close()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def reports(self) -> Iterator[dict[str, Any]]:
        """What it tells, until it has ended; raises why it ended where that was not asked for."""
        assert self._process.stdout is not None  # noqa: S101 - a pipe, as asked for above
        for line in self._process.stdout:
            facts = msgspec.json.decode(line)
            if facts["state"] == "failed":
                self._process.wait(_PATIENCE)
                kind = WIRE_ERRORS.get(facts["code"], QuadctlError)
                raise kind(facts["message"], facts["hint"])
            yield facts
            if facts["state"] == "done":
                return
        code = self._process.wait(_PATIENCE)
        hint = "its lines above say why"
        if self._file.exists():
            hint = f"`quadctl bag repair {self._file}` makes what there is of it whole"
        raise QuadctlError(f"the recorder ended before its file was whole (exit {code})", hint)

    def stop(self) -> None:
        """Ask it to make its file whole, and to end."""
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGTERM if sys.platform == "win32" else signal.SIGINT)
        self._limit.start()
