"""Real system under measurement on a separate realm, driven like a user drives it."""

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
    """Folder of realms, and the environment of the commands that use them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        # Commands start warm, with bytecode, even if this shell turns bytecode off.
        kept = {name: value for name, value in os.environ.items() if not name.startswith(_PRIVATE)}
        self.environment = kept | {"XDG_RUNTIME_DIR": str(folder), "QUADCTL_REALM": REALM}

    @property
    def endpoint(self) -> str:
        """Return the endpoint of the realm's hub."""
        return f"unixsock-stream/{self.folder / 'quadctl' / REALM / 'hub.sock'}"

    @property
    def raw(self) -> dict[str, str]:
        """Return the environment of a bare Zenoh process, with the threads of our clients."""
        return self.environment | {"ZENOH_RUNTIME": session.CLIENT_THREADS}

    def quadctl(self, *words: str) -> str:
        """Return the output of a command; raise CalledProcessError if it fails."""
        done = subprocess.run(
            [QUADCTL, *words], env=self.environment, stdin=subprocess.DEVNULL,
            capture_output=True, text=True, timeout=30, check=True,
        )  # fmt: skip
        return done.stdout

    def nodes(self) -> dict[str, dict[str, Any]]:
        """Return the row of each node in `status`, by name."""
        status: Any = json.loads(self.quadctl("status", "--json"))
        return {node["name"]: node for node in status["nodes"]}

    def processes(self) -> dict[int, str]:
        """Return every live process that was started in this home: names by pid."""
        status: Any = json.loads(self.quadctl("status", "--json"))
        names = {node["pid"]: node["name"] for node in status["nodes"]}
        names[status["pid"]] = "supervisor"
        return {pid: names.get(pid, f"pid {pid}") for pid in self.pids()}

    def pids(self) -> list[int]:
        """Return the pids of all live processes of this home, recorded or not."""
        return started_with("XDG_RUNTIME_DIR", str(self.folder))


@contextmanager
def home() -> Iterator[Home]:
    """Create a home in a fresh folder; on exit, end all processes of that home.

    The folder's name is short, because a Unix socket's path may have 100 characters.
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
def running(*words: str, compiled: bool = True) -> Iterator[Home]:
    """Start the whole system, or a vehicle that cannot be `compiled`; its home stops it again."""
    with home() as where:
        if not compiled:
            # A numba that cannot be imported, and no code of an earlier run.
            (where.folder / "numba.py").write_text("raise ImportError\n", encoding="utf-8")
            folder = str(where.folder)
            where.environment.update(PYTHONPATH=folder, XDG_CACHE_HOME=folder)
        where.quadctl("up", "-d", *words)
        yield where


@contextmanager
def hub() -> Iterator[Home]:
    """Start our hub alone."""
    with home() as where, process([*PYTHON, "quadctl.services.hub"], where.environment):
        yield where


def started_with(name: str, value: str) -> list[int]:
    """Return the pids of live processes with this variable in their environment."""
    mark = os.fsencode(f"{name}={value}\0")
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if mark in (path / "environ").read_bytes():
                found.append(int(path.name))
        except OSError:
            continue  # ended during the scan, or belongs to another user
    return [pid for pid in found if alive(pid)]


def alive(pid: int) -> bool:
    """Return whether a process exists and is no zombie."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def gone_after(found: list[int], within: float = _LONGEST) -> float:
    """Return the seconds until all processes have ended; raise Failed beyond `within`."""
    began = time.perf_counter()
    while any(alive(pid) for pid in found):
        if time.perf_counter() - began > within:
            raise Failed(f"still there: {[pid for pid in found if alive(pid)]}")
        time.sleep(0.001)
    return time.perf_counter() - began
