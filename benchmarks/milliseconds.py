"""Command that splits one command's time into stages: `python -m benchmarks.milliseconds [WORD...]`.

It runs a command (by default one service call) many times on a running system. It prints the median
of each stage, in elapsed time and in processor time (which a busy machine increases less), and in turn
the median of the installed command from outside. An interpreter that keeps the time measures the
stages of the same command; that costs a few milliseconds.
"""

import argparse
import json
import statistics
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path

from benchmarks.commands import whole
from benchmarks.system import QUADCTL, Home, running

_STAGES = Path(__file__).with_name("ours") / "stages.py"
_CALL = ("service", "call", "toggle_cage", "cage_on=true")


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("words", nargs="*", default=_CALL, metavar="WORD")
    options = parser.parse_args()
    passed: defaultdict[str, list[float]] = defaultdict(list)
    worked: defaultdict[str, list[float]] = defaultdict(list)
    with running() as home:
        # The first run warms up caches and bytecode.
        whole([QUADCTL, *options.words], home.environment)
        for _ in range(options.runs):
            for clock, taken in ((time.monotonic, passed), (time.process_time, worked)):
                for name, seconds in stages(home, clock, options.words).items():
                    taken[name].append(seconds * 1e3)
            installed = whole([QUADCTL, *options.words], home.environment)
            passed["the installed command, whole"].append(installed * 1e3)
    print(f"{'ms, median':36} {'passed':>8} {'processor':>10}")
    for name, times in passed.items():
        processor = f"{statistics.median(worked[name]):10.1f}" if name in worked else ""
        print(f"{name:36} {statistics.median(times):8.1f} {processor}")
    return 0


def stages(home: Home, clock: Callable[[], float], words: Sequence[str]) -> dict[str, float]:
    """Return the seconds of each stage of one run, by a clock of `time`, and their sum."""
    entry = metadata.distribution("quadctl").entry_points["quadctl"].value
    outside = clock is time.monotonic
    started = clock() if outside else 0.0
    done = subprocess.run(
        [sys.executable, str(_STAGES), clock.__name__, str(started), entry, *words],
        env=home.environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True,
    )  # fmt: skip
    ended = clock()
    said = json.loads(done.stderr.splitlines()[-1])
    found: dict[str, float] = said["stages"]
    # The processor clock of another process cannot measure the exit.
    found["exit"] = ended - said["left"] if outside else 0.0
    return found | {"whole": sum(found.values())}


if __name__ == "__main__":
    sys.exit(main())
