"""Description of the machine, the versions and the date of a run."""

import os
import platform
import subprocess
import time
import timeit
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import ros
from quadctl.cli.doctor.installation import build

_PACKAGES = ("eclipse-zenoh", "msgspec", "typer", "numpy")
_CPUINFO = Path("/proc/cpuinfo")
_WRITTEN = (":!benchmarks/*.json", ":!docs/figures.md", ":!docs/promises.md")
"""Files that a run itself writes: a commit is not changed by them."""


def described() -> dict[str, Any]:
    """Return the description for the file of figures."""
    packages = {name: metadata.version(name) for name in _PACKAGES}
    if not ros.absent():
        packages["rospy"] = _said("dpkg-query", "-W", "-f", "${Version}", "python3-rospy")
    return {
        "commit": commit(),
        "date": _said("date", "-u", "+%Y-%m-%d"),
        "processor": _processor(),
        "system": f"{platform.system()} {platform.release()}",
        "python": f"{platform.python_version()} ({build()})",
        "packages": packages,
        # Other load on the machine increases every figure; ratios change less.
        "load": round(os.getloadavg()[0], 1),
    }


def speeds() -> dict[str, float]:
    """Return the time (ns) of a turn of a Python loop, of a random read, and of a wake-up from sleep.

    Machines differ in each: a figure in seconds or in shares of a core compares only with figures of
    machines like this. A wake-up counts as processor time, after 50 ms of sleep.
    """
    turns, reads, sleeps = 1_000_000, 1_000_000, 20
    memory = np.ones(2**25)
    places = np.random.default_rng(0).integers(0, memory.size, reads)
    before = time.process_time_ns()
    for _ in range(sleeps):
        time.sleep(0.05)
    return {
        "wake": (time.process_time_ns() - before) / sleeps,
        "loop": 1e9 * min(timeit.repeat("x += 1", "x = 0", number=turns, repeat=5)) / turns,
        "read": 1e9 * min(timeit.repeat(lambda: memory[places], number=1, repeat=5)) / reads,
    }


def commit() -> str:
    """Return the commit of the checkout, with `-dirty` if its sources have changed since."""
    changed = _said("git", "status", "--porcelain", "--untracked-files=no", "--", ".", *_WRITTEN)
    return _said("git", "rev-parse", "--short", "HEAD") + ("-dirty" if changed else "")


def _said(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


def _processor() -> str:
    if not _CPUINFO.exists():
        return platform.processor()
    lines = _CPUINFO.read_text(encoding="utf-8").splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{len(models)} x {models[0]}"
