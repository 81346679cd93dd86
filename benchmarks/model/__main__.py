"""Command that measures the flight model beside its peers, in turn, each in a separate process.

    python -m benchmarks.model [--only NAME]... [--write] [--check] [--out FILE]

Peers are installed below .cache when first needed. --write writes model.json and docs/figures.md.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from benchmarks import machine
from benchmarks.model import environments
from benchmarks.model.environments import Missing
from benchmarks.model.figures import BARS, PAIRED, RUNNERS, Runner, tables
from benchmarks.model.flops import step_flops
from benchmarks.tables import replace

FILE = Path(__file__).parents[1] / "model.json"
_OURS = ("plain", "compiled")


def main() -> int:
    options = _parser().parse_args()
    if options.write and options.only:
        _parser().error("--write is for a whole run: leave out --only")
    found: dict[str, Any] = {
        "machine": machine.described(), "flops": step_flops(), "peak": 0.0,
        "rates": {}, "paired": {}, "imports": {}, "memory": {}, "versions": {}, "missing": {},
    }  # fmt: skip
    for runner in RUNNERS:
        key = runner.key
        if options.only and key not in options.only:
            found["missing"][key] = "not measured"
            continue
        try:
            said = json.loads(_measured(runner))
        except Missing as error:
            found["missing"][key] = str(error)
            print(f"{runner.name}: {error}", file=sys.stderr)
            continue
        found["peak"] = said["rates"].pop("peak", {}).get("1", found["peak"])
        found["rates"][key], found["imports"][key] = said["rates"], said["import"]
        found["versions"][key], found["memory"][key] = said["version"], said["memory"]
        print(f"{runner.name}: {json.dumps(said['rates'])}", flush=True)
    if {PAIRED.ours, PAIRED.peer} <= found["rates"].keys():
        found["paired"] = json.loads(_said("benchmarks.model.paired"))
    print(tables(found))
    for path in ([FILE] if options.write else []) + ([options.out] if options.out else []):
        path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.write:
        replace("figures.md", "model", tables(found))
    verdicts = [bar.verdict(found["rates"], found["paired"]) for bar in BARS]
    return 1 if options.check and "missed" in verdicts else 0


def _measured(runner: Runner) -> str:
    """Return the figures that a runner printed; raise Missing if it cannot run."""
    key = runner.key
    if runner.peer:
        return environments.run(runner.peer, f"{key}_speed")
    return _said("benchmarks.model.ours" if key in _OURS else "benchmarks.model.reference", key)


def _said(*words: str) -> str:
    """Return the output of one of our modules; raise Missing if it fails."""
    done = subprocess.run(
        [sys.executable, "-m", *words],
        cwd=environments.ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise Missing(done.stderr.strip().splitlines()[-1])
    return done.stdout


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = [runner.key for runner in RUNNERS]
    parser.add_argument("--only", action="append", choices=names, help="measure only this one")
    parser.add_argument("--write", action="store_true", help="write model.json and docs/figures.md")
    parser.add_argument("--check", action="store_true", help="exit 1 if a bar is missed")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="write the figures to FILE, as JSON"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
