"""Measures the running system from outside, through `quadctl`, and writes the figures.

    python -m benchmarks.measure [--runs N] [--cycles N] [--write]

Prints each figure beside its bar; `--write` puts them into benchmarks/figures.json and into the
README's table. Exit 1 where a bar is missed.
"""

import argparse
import json
import platform
import subprocess
import sys
from pathlib import Path

from benchmarks import flights, launches, readme

FILE = Path(__file__).with_name("figures.json")


def main() -> int:
    """Measure, print, write, judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="of each launch")
    parser.add_argument("--cycles", type=int, default=100, help="starts and stops")
    parser.add_argument("--write", action="store_true", help="figures.json and the README")
    options = parser.parse_args()
    figures = [
        *launches.measure(options.runs, options.cycles),
        *flights.measure(),
    ]
    for figure in figures:
        print(figure.line(), flush=True)
    if options.write:
        document = {"machine": machine(), "figures": [figure.plain() for figure in figures]}
        FILE.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
        readme.write(document)
    return 0 if all(figure.holds for figure in figures) else 1


def machine() -> dict[str, str]:
    """What was measured, where and when."""

    def said(*command: str) -> str:
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()

    model = (
        [
            line.partition(":")[2].strip()
            for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
            if line.startswith("model name")
        ]
        if Path("/proc/cpuinfo").exists()
        else [platform.processor()]
    )
    return {
        "commit": said("git", "rev-parse", "--short", "HEAD"),
        "date": said("date", "-u", "+%Y-%m-%d"),
        "processor": f"{len(model)} x {model[0]}",
        "python": platform.python_version(),
        "system": platform.system(),
    }


if __name__ == "__main__":
    sys.exit(main())
