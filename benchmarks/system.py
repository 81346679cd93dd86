"""A real system to measure, on a realm of its own, driven as a user drives it."""

import contextlib
import json
import os
import signal
import subprocess
import sysconfig
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.children import PYTHON, Failed, process
from quadctl.services.runtime.bus import session

QUADCTL = str(Path(sysconfig.get_path("scripts")) / "quadctl")
REALM = "bench"
_PRIVATE = ("PYTHON", "QUADCTL", "ZENOH", "XDG_RUNTIME_DIR")
_LONGEST = 10.0


class Home:
    """A folder that realms live in, and the environment of the commands that use it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        # Commands start warm, with bytecode, whatever this shell has set.
        kept = {name: value for name, value in os.environ.items() if not name.startswith(_PRIVATE)}
        self.environment = kept | {"XDG_RUNTIME_DIR": str(folder), "QUADCTL_REALM": REALM}

    @property
    def endpoint(self) -> str:
        """Where the realm's hub listens."""
        return f"unixsock-stream/{self.folder / 'quadctl' / REALM / 'hub.sock'}"

    @property
    def raw(self) -> dict[str, str]:
        """The environment of a bare Zenoh process: with the threads that our clients have."""
        return self.environment | {"ZENOH_RUNTIME": session.CLIENT_THREADS}

    def quadctl(self, *words: str) -> str:
        """What a command prints; raises CalledProcessError where it fails."""
        done = subprocess.run(
            [QUADCTL, *words], env=self.environment, stdin=subprocess.DEVNULL,
            capture_output=True, text=True, timeout=30, check=True,
        )  # fmt: skip
        return done.stdout

    def nodes(self) -> dict[str, dict[str, Any]]:
        """What `status` says of each node, by name."""
        status: Any = json.loads(self.quadctl("status", "--json"))
        return {node["name"]: node for node in status["nodes"]}

    def processes(self) -> dict[int, str]:
        """Every live process that was started in this home, by pid, with a name."""
        status: Any = json.loads(self.quadctl("status", "--json"))
        names = {node["pid"]: node["name"] for node in status["nodes"]}
        names[status["pid"]] = "supervisor"
        return {pid: names.get(pid, f"pid {pid}") for pid in self.pids()}

    def pids(self) -> list[int]:
        """Every live process that was started in this home, recorded or not."""
        return started_with("XDG_RUNTIME_DIR", str(self.folder))


@contextmanager
def home() -> Iterator[Home]:
    """A home in a fresh folder; whatever still runs there in the end is ended.

    Its name is short: a Unix socket's path may have 100 characters.
    """
    with tempfile.TemporaryDirectory(prefix="qb-", dir="/tmp") as folder:
        where = Home(Path(folder))
        try:
            yield where
        finally:
            if where.pids():
                subprocess.run(
                    [QUADCTL, "down"], env=where.environment, capture_output=True, check=False
                )
            for pid in where.pids():
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)


@contextmanager
def running(*words: str) -> Iterator[Home]:
    """The whole system, up; its home takes it down again."""
    with home() as where:
        where.quadctl("up", "-d", *words)
        yield where


@contextmanager
def hub() -> Iterator[Home]:
    """Our hub, alone."""
    with home() as where, process([*PYTHON, "quadctl.services.hub"], where.environment):
        yield where


def started_with(name: str, value: str) -> list[int]:
    """Every live process with this in its environment."""
    mark = os.fsencode(f"{name}={value}\0")
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if mark in (path / "environ").read_bytes():
                found.append(int(path.name))
        except OSError:
            continue  # it ended while we looked, or is another user's
    return [pid for pid in found if alive(pid)]


def alive(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def gone_after(found: list[int], within: float = _LONGEST) -> float:
    """Seconds until none of the processes is left; raises Failed beyond `within`."""
    began = time.perf_counter()
    while any(alive(pid) for pid in found):
        if time.perf_counter() - began > within:
            raise Failed(f"still there: {[pid for pid in found if alive(pid)]}")
        time.sleep(0.001)
    return time.perf_counter() - began
