"""`param diff`: what the running system has otherwise than a file."""

from pathlib import Path
from typing import Annotated

from cli import output
from cli.declare import Arg
from cli.options import Options
from cli.param.changes import DEFAULT_FILE, changes, file_values, known_of, lines
from cli.param.running import Running


def diff(
    options: Options,
    file: Annotated[
        Path | None, Arg("A parameter file (default: ./quad.toml, else the defaults in code).")
    ] = None,
) -> None:
    """Show what differs from a file: its value, and what the running system has.

    Example: quadctl param diff quad.toml
    """
    source = file or (DEFAULT_FILE if DEFAULT_FILE.exists() else None)
    said = file_values(source, options)
    with Running(options) as running:
        now = running.whole()
    found = changes(known_of(said, now), now)
    if options.json:
        output.document([change.document("file", "running") for change in found])
    else:
        lines(found)
