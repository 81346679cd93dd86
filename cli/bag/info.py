"""`bag info`: what a recording holds."""

import time
from pathlib import Path
from typing import Annotated

import msgspec

from cli import output
from cli.declare import Arg
from cli.options import Options
from services.runtime.recording.reader import BagFacts, KeyFacts, facts

Recording = Annotated[Path, Arg("A recording, MCAP.", "FILE")]


def info(options: Options, file: Recording) -> None:
    """Show what a recording holds; of one that is cut, all that is there.

    Example: quadctl bag info flight.mcap
    """
    found = facts(file)
    if options.json:
        output.document({"ok": not found.cut, **msgspec.to_builtins(found)})
        return
    output.table(_head(found))
    if found.keys:
        output.table([("KEY", "TYPE", "MESSAGES", "HZ"), *map(_row, found.keys)])
    if found.cut:
        output.note(f"it is cut: {found.cut}\n  try: `quadctl bag repair {file}` makes it whole")


def _head(found: BagFacts) -> list[tuple[str, str]]:
    began = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(found.begin))
    return [
        ("File:", found.file),
        ("Size:", f"{found.bytes / 1e6:.2f} MB"),
        ("Began:", began if found.messages else "-"),
        ("Length:", f"{found.seconds:.1f} s"),
        ("Messages:", str(found.messages)),
    ]


def _row(key: KeyFacts) -> tuple[str, str, str, str]:
    what = key.type or key.encoding
    name = f"{key.key} (for viewers)" if key.derived else key.key
    return name, what, str(key.messages), f"{key.hz:.1f}" if key.hz else "-"
