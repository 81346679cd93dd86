"""One child process: started, listened to, ended."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping

from services.runtime import forked
from services.runtime.forked import Forked
from services.runtime.processes import Process

_LAST_WORDS = 0.2
"""Seconds to wait for what an ended process wrote last; a grandchild may keep the pipe open."""


class Child:
    """A running process. `on_line` and `on_end` are called from a thread of its own."""

    def __init__(
        self,
        process: Process,
        environment: Mapping[str, str],
        folder: str,
        on_line: Callable[[str], None],
        on_end: Callable[[], None],
    ) -> None:
        """Start it."""
        self._on_line, self._on_end = on_line, on_end
        # In a session of its own: Ctrl-C is the supervisor's to hear, and to pass on in order.
        # Our nodes watch their stdin: they end when we do, however we do.
        self._popen: subprocess.Popen[bytes] | Forked
        if not process.stranger and forked.possible():
            self._popen = Forked(process.command[-1], environment, folder, both=True)
        else:
            leash = (sys.executable, "-P", "-m", "services.runtime.leash", str(os.getpid()))
            self._popen = subprocess.Popen(
                (*leash, *process.command) if process.stranger else process.command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env={**os.environ, **environment},
                cwd=folder,
                start_new_session=True,
            )
        self._reader = threading.Thread(target=self._read, daemon=True)

    def listen(self) -> None:
        """Hear what it says, from now on; a thread more, after which nothing can be forked."""
        self._reader.start()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._popen.pid

    def exit_code(self) -> int | None:
        """How it ended, None while it runs."""
        return self._popen.poll()

    def terminate(self) -> None:
        """Ask it to end."""
        self._signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it, and what it started, at once."""
        self._signal(signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)

    def wait(self, timeout: float) -> bool:
        """Whether it has ended within so many seconds."""
        try:
            self._popen.wait(max(timeout, 0))
        except subprocess.TimeoutExpired:
            return False
        return True

    def last_words(self) -> str:
        """Read to the end of what it wrote; returns how it ended."""
        self._reader.join(_LAST_WORDS)
        code = self._popen.poll()
        if code is None:
            return "still running"
        return f"exit {code}" if code >= 0 else signal.Signals(-code).name

    def _signal(self, number: int) -> None:
        if self._popen.poll() is not None:
            return
        if sys.platform == "win32":
            self._popen.send_signal(signal.SIGTERM)
        else:
            os.killpg(self._popen.pid, number)

    def _read(self) -> None:
        assert self._popen.stdout is not None  # noqa: S101 - a pipe, as asked for above
        for raw in self._popen.stdout:
            self._on_line(raw.decode(errors="replace").rstrip("\r\n"))
        self._on_end()
