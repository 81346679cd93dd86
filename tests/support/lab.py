"""Real system under test: started, used and stopped as by a user, with nothing left behind."""

import itertools
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import zenoh

from tests.support.bare import Bare, pack
from tests.support.running import DEADLINE, Done, Foreground, alive, eventually, is_frozen

NODES = ["hub", "dynamics", "pressure", "safety"]
QUADCTL = [sys.executable, "-P", "-m", "quadctl.cli.main"]
PATIENT = ("--set", "safety.pose_timeout=0.6", "--set", "dynamics.setpoint_timeout=0.6")
"""Options of `up` that prevent a busy machine from stopping a flight."""


def sets(*assignments: object) -> tuple[object, ...]:
    """Return the options of a command that set these values, e.g. `dynamics.seed=1`."""
    return tuple(word for each in assignments for word in ("--set", each))


_PRIVATE = ("QUADCTL_", "XDG_RUNTIME_DIR", "ZENOH_", "PYTHON", "NO_COLOR")
"""Prefixes of environment variables that a lab does not inherit."""
CACHE = Path(__file__).parents[2] / ".cache"
"""Folder of compiled code, in the checkout, kept for the next test run."""
_numbers = itertools.count()


class Lab:
    """One realm in its own folder; `folder` is also the working directory of its commands.

    `enter` is put before each command, to run it on another machine.
    """

    def __init__(self, folder: Path, enter: Sequence[str] = ()) -> None:
        self._quadctl = [*enter, *QUADCTL]
        self.realm, self.folder = f"lab{next(_numbers)}", folder
        self.runtime = folder / "run"
        self.runtime.mkdir(mode=0o700)
        inherited = {k: v for k, v in os.environ.items() if not k.startswith(_PRIVATE)}
        self.environment = inherited | {
            "XDG_RUNTIME_DIR": str(self.runtime),
            "QUADCTL_REALM": self.realm,
            "XDG_CACHE_HOME": str(CACHE),
        }
        self._foreground: list[Foreground] = []
        self._launched: dict[tuple[str, str], dict[str, Any]] = {}

    @property
    def home(self) -> Path:
        """Return the realm's folder."""
        return self.runtime / "quadctl" / self.realm

    def quadctl(self, *words: object, timeout: float = DEADLINE, **environment: str) -> Done:
        """Run one command of quadctl to its end."""
        return self.run(self.command(*words), timeout, **environment)

    def run(self, command: Sequence[str], timeout: float = DEADLINE, **environment: str) -> Done:
        """Run any program to its end, in the realm's folder and environment."""
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=timeout,
            env=self.environment | environment,
            cwd=self.folder,
            check=False,
        )
        return Done(done.returncode, done.stdout, done.stderr)

    def each(self, lines: Iterable[str], *more: str) -> dict[str, Done]:
        """Run independent commands concurrently, and return their results by line."""

        def run(line: str) -> Done:
            return self.quadctl(*shlex.split(line), *more)

        lines = list(lines)
        with ThreadPoolExecutor(4) as pool:
            return dict(zip(lines, pool.map(run, lines), strict=True))

    def start(self, *words: object) -> Done:
        """Run `quadctl up -d`, which must succeed; a slow start may report its progress.

        It also names the processes of the file that it runs.
        """
        done = self.quadctl("up", "-d", *words)
        assert (done.code, done.out) == (0, f"realm {self.realm} is up\n"), done
        notes = [line.partition(": ") for line in done.err.splitlines()]
        assert all(name in {"starting", *self.nodes()} and what for name, _, what in notes), done
        return done

    def share(self, *words: object) -> None:
        """Start a run for several tests, each of which begins with `put_back`."""
        self.start(*words)
        with self.bare() as bare:
            self._launched = self._parameters(bare)

    def put_back(self) -> None:
        """Undo what an earlier test may have left: parameters, cage, baseline, and goals with their flights.

        Each vehicle hovers at its start, in a new boot.
        """
        with self.bare() as bare:
            for (vehicle, node), now in self._parameters(bare).items():
                launched = self._launched[vehicle, node]
                changed = {name: launched[name] for name in now if now[name] != launched[name]}
                if changed:
                    set_ = bare.query(
                        f"{vehicle}/@srv/{node}/set_params", pack({"values": changed})
                    )
                    assert set_.value["success"], set_
            bare.restart(self.status()["vehicles"])

    @contextmanager
    def put_back_session(self) -> Iterator[Bare]:
        """Put the run back, and yield a bare session."""
        self.put_back()
        with self.bare() as session:
            yield session

    def _parameters(self, bare: Bare) -> dict[tuple[str, str], dict[str, Any]]:
        """Return the parameters of each vehicle's node."""
        return {
            (vehicle, node): bare.query(
                f"{vehicle}/@srv/{node}/get_params", pack({"names": []})
            ).value["values"]
            for vehicle in self.status()["vehicles"]
            for node in NODES
            if node != "hub"
        }

    def foreground(self, *words: object) -> Foreground:
        """Run `quadctl up` in the foreground, and wait until all nodes are ready."""
        run = self.spawn(*self.command("up", *words))
        eventually(self.is_ready)
        return run

    def spawn(self, *command: str) -> Foreground:
        """Start any process beside the test, in the realm's environment."""
        log = self.folder / f"log{next(_numbers)}"
        process = Foreground(list(command), self.environment, self.folder, log)
        self._foreground.append(process)
        return process

    def log(self, node: str) -> str:
        """Return the log of a node so far; a run can be up before all of it is written."""
        try:
            return (self.home / "logs" / f"{node}.log").read_text(encoding="utf-8")
        except FileNotFoundError:
            return ""

    def file(self, text: str, name: str = "lab.toml") -> Path:
        """Write a parameter file."""
        path = self.folder / name
        path.write_text(text, encoding="utf-8")
        return path

    def status(self) -> dict[str, Any]:
        """Return the run record that `quadctl status --json` prints, without nodes if there is no run."""
        try:
            record: dict[str, Any] = json.loads((self.home / "run.json").read_bytes())
        except FileNotFoundError:
            return {"pid": 0, "nodes": []}
        return record

    def nodes(self) -> dict[str, dict[str, Any]]:
        """Return the status of each node, by name."""
        return {node["name"]: node for node in self.status()["nodes"]}

    def is_ready(self) -> bool:
        nodes = self.nodes().values()
        return bool(nodes) and all(node["state"] == "ready" for node in nodes)

    def pids(self) -> list[int]:
        """Return the pids of the supervisor and its children, from the record."""
        status = self.status()
        return [status["pid"], *(node["pid"] for node in status["nodes"])]

    def signal(self, node: str, number: int) -> int:
        """Send a signal to a node, and return its pid; SIGSTOP has its effect by then."""
        pid: int = self.nodes()[node]["pid"]
        os.kill(pid, number)
        if number == signal.SIGSTOP:
            eventually(lambda: is_frozen(pid))
        return pid

    @contextmanager
    def frozen(self, node: str) -> Iterator[int]:
        """Freeze a node for the block, and yield its pid.

        On a busy machine its supervisor may have replaced it at the end.
        """
        pid = self.signal(node, signal.SIGSTOP)
        try:
            yield pid
        finally:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)

    def revived(self, node: str, old: int, within: float = DEADLINE) -> None:
        """Wait until the node is ready as another process."""

        def is_back() -> bool:
            now = self.nodes()[node]
            return now["state"] == "ready" and now["pid"] not in {0, old}

        eventually(is_back, within, lambda: f"{self.nodes()}\n{self.log('up')}")

    def command(self, *words: object) -> list[str]:
        """Return the command line of `quadctl`, for a process beside the test."""
        return [*self._quadctl, *map(str, words)]

    def try_bare(self) -> Bare | None:
        """Return a bare session, or None while no hub listens."""
        try:
            return self.bare()
        except zenoh.ZError:
            return None

    def first_bare(self) -> Bare:
        """Wait until a hub listens, and return a bare session."""
        found = eventually(self.try_bare)
        assert found is not None
        return found

    def bare(self) -> Bare:
        """Open a session that shares no code with the system."""
        return Bare(f"unixsock-stream/{self.home / 'hub.sock'}")

    def processes(self) -> list[int]:
        """Return every live process that was started in this lab, recorded or not."""
        mark = os.fsencode(f"XDG_RUNTIME_DIR={self.runtime}\0")
        found = []
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                if mark in (folder / "environ").read_bytes():
                    found.append(int(folder.name))
            except OSError:
                continue  # the process has just ended, or belongs to another user
        return [pid for pid in found if alive(pid)]

    def taken_logs(self) -> dict[str, str]:
        """Remove the logs that a failed start has left, and nothing else; return them by file."""
        eventually(lambda: not self.processes())
        assert [path.name for path in self.home.iterdir()] == ["logs"]
        logs = {path.name: path.read_text(encoding="utf-8") for path in self.home.glob("logs/*")}
        shutil.rmtree(self.home)
        return logs

    def is_gone(self) -> bool:
        """Return whether neither a process nor the folder is left."""
        return not self.processes() and not self.home.exists()

    def finish(self) -> None:
        """Stop the run, and assert that nothing is left."""
        try:
            if self.processes():
                self.quadctl("down")
            eventually(lambda: not self.processes())
            assert not self.home.exists(), sorted(self.home.iterdir())
        finally:
            for pid in self.processes():
                os.kill(pid, signal.SIGKILL)
            for process in self._foreground:
                process.end()


@contextmanager
def private_lab(enter: Sequence[str] = ()) -> Iterator[Lab]:
    """Create a lab in a new folder with a short name: a socket's path has at most 100 bytes."""
    folder = Path(tempfile.mkdtemp(prefix="q", dir="/tmp"))
    try:
        made = Lab(folder, enter)
        try:
            yield made
        finally:
            made.finish()
    finally:
        shutil.rmtree(folder)
