"""Measuring processes from outside: start, request, and a sure end."""

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

PYTHON = (sys.executable, "-P", "-m")
TOP = {"PYTHONPATH": str(Path(__file__).parents[1])}
"""Path of the package `benchmarks`, which is not installed, for measuring processes."""
_GRACE = 5.0


class Failed(Exception):
    """Failure of a measuring process."""


@contextmanager
def process(
    command: Sequence[str], environment: Mapping[str, str]
) -> Iterator[subprocess.Popen[bytes]]:
    """Start a process in its own group; on exit, kill the rest of the group."""
    started = subprocess.Popen(
        command, env=TOP | dict(environment), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        yield started
    finally:
        end(started)


def end(started: subprocess.Popen[bytes]) -> None:
    """End the whole group: with SIGINT, then with SIGKILL."""
    if started.poll() is None:
        started.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            started.wait(_GRACE)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(started.pid, signal.SIGKILL)
    started.wait()


class Worker:
    """Process that answers requests in JSON lines; it ends with its `with` block."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        self._name = " ".join(command)
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed in __exit__
        self._process = subprocess.Popen(
            command, env=TOP | dict(environment), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=self._log, start_new_session=True,
        )  # fmt: skip

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def ready(self) -> None:
        """Wait until the process accepts requests; raise Failed if it does not."""
        self.answer(20.0)

    def tell(self, do: str, **arguments: object) -> None:
        """Send a request without reading the answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"do": do, **arguments}).encode() + b"\n")
        self._process.stdin.flush()

    def answer(self, timeout: float = 60.0) -> Any:
        """Return the answer to the oldest open request; raise Failed without one."""
        pipe = self._process.stdout
        assert pipe is not None
        readable, _, _ = select.select([pipe], [], [], timeout)
        line = pipe.readline() if readable else b""
        if not line:
            self._log.seek(0)
            said = self._log.read().decode(errors="replace").strip()[-500:]
            raise Failed(f"{self._name}: {said or f'no answer within {timeout:g} s'}")
        return json.loads(line)

    def ask(self, do: str, timeout: float = 60.0, **arguments: object) -> Any:
        """Send a request and return the answer; raise Failed without one."""
        self.tell(do, **arguments)
        return self.answer(timeout)


@contextmanager
def workers(*wanted: tuple[Sequence[str], Mapping[str, str]]) -> Iterator[list[Worker]]:
    """Start several workers side by side, and wait until all are ready."""
    with contextlib.ExitStack() as stack:
        started = [stack.enter_context(Worker(*each)) for each in wanted]
        for worker in started:
            worker.ready()
        yield started
