"""Command that measures quadctl beside bare Zenoh and ROS 1 in one run, with a verdict per bar.

    python -m benchmarks.measure [--only GROUP]... [--quick] [--check] [--write] [--out FILE]
    python -m benchmarks.measure --file FILE --check

It prints each figure with its peers and its bars. A row that cannot be measured is reported as
failed and does not stop the others; a peer that is not installed is reported as such.
"""

import argparse
import json
import signal
import sys
import traceback
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from benchmarks import document, report, tables
from benchmarks.bars import judge
from benchmarks.effort import QUICK, Effort
from benchmarks.results import Results
from benchmarks.rows import BY_KEY, GROUPS, ROWS

FILE = Path(__file__).with_name("figures.json")
_CTRL_C = 130


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, write and judge; return the exit code."""
    options = _parser().parse_args(arguments)
    if options.write and (options.only or options.quick or options.file):
        _parser().error("--write is for a whole run: leave out --only, --quick and --file")
    if options.file is not None:
        found = json.loads(options.file.read_bytes())
        for row, figure in document.figures(found):
            print(report.line(row, figure))
    else:
        # A shell's background jobs ignore SIGINT, and so would each command that is ended by it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        # However the run ends, the processes that it started end with it.
        before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
        try:
            found = run(options.only or GROUPS, QUICK if options.quick else Effort())
        except KeyboardInterrupt:
            return _CTRL_C
        finally:
            signal.signal(signal.SIGTERM, before)
    if options.write:
        _save(FILE, found)
        tables.write(found)
    if options.out is not None:
        _save(options.out, found)
    return verdict(found) if options.check else 0


def run(groups: Iterable[str], effort: Effort) -> dict[str, Any]:
    """Measure the groups, print each row when it is done, and return the document."""
    from benchmarks import machine
    from benchmarks.awake import awake
    from benchmarks.parts import PARTS

    results, groups = Results(), set(groups)
    described = machine.described() | {"speeds": machine.speeds()}
    with awake():
        for part in PARTS:
            if part.group not in groups:
                continue
            try:
                part.measure(results, effort)
            except Exception as error:  # noqa: BLE001 - a part that fails is reported, the others continue
                traceback.print_exc()
                results.fail(part.keys, f"{type(error).__name__}: {error}")
            for key in part.keys:
                print(report.line(BY_KEY[key], results.figure(key)), flush=True)
    figures = [document.entry(row, results.figure(row.key)) for row in ROWS if row.group in groups]
    return {"machine": described, "figures": figures, "notes": results.notes}


def verdict(found: dict[str, Any]) -> int:
    """Return 1 if a row was not measured or missed a bar for no known reason, else 0; print both."""
    code = 0
    for row, figure in document.figures(found):
        said = judge(figure, row.bars)
        if said not in {"missed", "failed"}:
            continue
        excused = row.known is not None and row.known.excuses(figure, row.bars)
        print(f"{said}{', as known' if excused else ''}: {row.name}", file=sys.stderr)
        code = code if excused else 1
    return code


def _save(path: Path, found: dict[str, Any]) -> None:
    path.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", choices=GROUPS, metavar="GROUP",
                        help=f"measure only this part: {', '.join(GROUPS)}")  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="trial with few repetitions")
    parser.add_argument(
        "--check", action="store_true", help="exit 1 if a bar is missed for no known reason"
    )
    parser.add_argument(
        "--write", action="store_true", help="write figures.json and docs/figures.md"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="write the figures to FILE, as JSON"
    )
    parser.add_argument(
        "--file", type=Path, metavar="FILE", help="judge this file; measure nothing"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
