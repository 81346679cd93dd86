"""A real system to measure, on a realm of its own, driven as a user drives it."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

QUADCTL = (sys.executable, "-P", "-m", "cli.main")


@contextmanager
def home() -> Iterator[dict[str, str]]:
    """An environment whose realms live in a folder of their own."""
    with tempfile.TemporaryDirectory(prefix="qb-") as folder:
        yield os.environ | {"XDG_RUNTIME_DIR": folder, "QUADCTL_REALM": "bench"}


def quadctl(environment: dict[str, str], *words: str) -> str:
    """Run a command to its end; raises CalledProcessError where it fails."""
    done = subprocess.run(
        [*QUADCTL, *words], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout


def pids(environment: dict[str, str]) -> list[int]:
    """The processes of the run, its supervisor among them."""
    status: Any = json.loads(quadctl(environment, "status", "--json"))
    return [status["pid"], *(node["pid"] for node in status["nodes"])]


def alive(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def gone_after(found: list[int], within: float) -> float:
    """Seconds until none of the processes is left; raises TimeoutError beyond `within`."""
    began = time.perf_counter()
    while any(alive(pid) for pid in found):
        if time.perf_counter() - began > within:
            raise TimeoutError(f"still there: {[pid for pid in found if alive(pid)]}")
        time.sleep(0.001)
    return time.perf_counter() - began
