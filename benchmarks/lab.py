"""Times of the lab: a class that is graded, and what `import quadctl` costs a program."""

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.children import Failed
from benchmarks.effort import Effort
from benchmarks.results import Results
from benchmarks.system import QUADCTL, home
from quadctl.cli.lab import trial

_LONGEST = 600.0
_SOLUTION = Path(trial.__file__).parent / "solutions" / "completed"
"""Hand-in that holds in every row, so that it flies longest."""


def measure_class(results: Results, effort: Effort) -> None:
    """Measure `lab grade` of a class, once."""
    with home() as where:
        folders = [where.folder / f"student_{number:02}" for number in range(effort.hand_ins)]
        for folder in folders:
            _write(folder)
        began = time.perf_counter()
        done = subprocess.run(
            [QUADCTL, "lab", "grade", *folders, "--format", "json", "--seed", "19"], env=where.environment,
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_LONGEST, check=False,
        )  # fmt: skip
        seconds = time.perf_counter() - began
    if done.returncode:
        raise Failed(f"lab grade: exit {done.returncode}: {done.stderr[-500:]}")
    if not all(each["score"] == each["max_score"] for each in json.loads(done.stdout)):
        raise Failed("lab grade: a good hand-in did not get all points")
    results.seconds("grade_30", "ours", [seconds])


def _write(folder: Path) -> None:
    folder.mkdir()
    for file in _SOLUTION.iterdir():
        shutil.copy(file, folder / file.name.removesuffix(".txt"))


def measure_import(results: Results, effort: Effort) -> None:
    """Measure how much longer Python takes with `import quadctl`, in pairs."""
    with home() as where:
        # The first pair writes bytecode, and is not counted.
        for number in range(effort.commands + 1):
            took = []
            for line in ("import quadctl", "pass"):
                began = time.perf_counter()
                subprocess.run(
                    [sys.executable, "-P", "-c", line], env=where.environment, check=True
                )
                took.append(time.perf_counter() - began)
            if number:
                results.seconds("import", "ours", [took[0] - took[1]])
