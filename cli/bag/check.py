"""`bag check`: whether a recording is whole and right."""

import sys

from cli import output
from cli.bag.info import Recording
from cli.options import Options
from services.runtime.recording.verify import check as look_through

_FAULT_FOUND = 8


def check(options: Options, file: Recording) -> None:
    """Read every message against its schema and look for gaps; exit 8 where something is wrong.

    Example: quadctl bag check flight.mcap
    """
    found = look_through(file)
    ok = not found.faults
    if options.json:
        said = {"ok": ok, "file": str(file), "messages": found.messages, "faults": found.faults}
        output.document(said)
    else:
        for fault in found.faults:
            output.line(f"FAIL  {fault}")
        verdict = "whole and right" if ok else "not right; `quadctl bag repair` mends what is cut"
        output.line(f"{file}: {found.messages} messages, {verdict}")
    if not ok:
        sys.exit(_FAULT_FOUND)
