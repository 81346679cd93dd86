"""Processes of the tests, and helpers that wait for them."""

import json
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

T = TypeVar("T")

DEADLINE = 120.0
"""Seconds after which a test gives up waiting. No test that passes waits for so long, on a machine of any load."""


class Done(NamedTuple):
    """Exit code and output of a command."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Return the only document on stdout; fail if there is anything else."""
        return json.loads(self.out)

    @property
    def rows(self) -> list[Any]:
        """Return the documents of a stream, one per line."""
        return [json.loads(line) for line in self.out.splitlines()]

    @property
    def error(self) -> dict[str, str]:
        """Return the error document, the last line on stderr."""
        error: dict[str, str] = json.loads(self.err.splitlines()[-1])["error"]
        return error


def eventually(
    condition: Callable[[], T], within: float = DEADLINE, describe: Callable[[], str] = str
) -> T:
    """Poll until the condition is true and return its value, or fail with it and `describe()`."""
    deadline = time.monotonic() + within
    while not (answer := condition()):
        assert time.monotonic() < deadline, f"still {answer!r} after {within:g} s\n{describe()}"
        time.sleep(0.01)
    return answer


def alive(pid: int) -> bool:
    """Return whether a process runs; a zombie does not."""
    return _state(Path(f"/proc/{pid}")) not in "ZX"


def is_frozen(pid: int) -> bool:
    """Return whether no thread of a process runs any more.

    A SIGSTOP waits until the thread that takes it gets a core; meanwhile the others go on.
    """
    return all(_state(thread) in "TZX" for thread in Path(f"/proc/{pid}/task").glob("*"))


def _state(process: Path) -> str:
    """Return the letter of the state of a process or thread, X if it is gone."""
    try:
        stat = (process / "stat").read_text(encoding="utf-8", errors="replace")
    except (FileNotFoundError, ProcessLookupError):
        return "X"
    return stat.rpartition(")")[2].split()[0]


class Foreground:
    """Process beside the test, e.g. `quadctl up` without -d, with its output in a file."""

    def __init__(
        self, command: list[str], environment: dict[str, str], folder: Path, log: Path
    ) -> None:
        self._log = log
        with self._log.open("wb") as out:
            self._popen = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                env=environment,
                cwd=folder,
            )
        self.pid = self._popen.pid

    @property
    def log(self) -> str:
        """Return the whole output so far."""
        return self._log.read_text(encoding="utf-8")

    @property
    def ended(self) -> bool:
        return self._popen.poll() is not None

    def send(self, number: int) -> None:
        self._popen.send_signal(number)

    def wait(self, within: float = DEADLINE) -> int:
        """Wait for the end of the process, and return its exit code."""
        return self._popen.wait(within)

    def end(self) -> None:
        if not self.ended:
            self._popen.kill()
        self._popen.wait()
