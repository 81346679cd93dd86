"""`param save`: writes the running system's values into a file."""

from pathlib import Path
from typing import Annotated

from cli import output
from cli.declare import Arg
from cli.options import Options
from cli.param.changes import DEFAULT_FILE, changes, file_values, known_of, lines, values_of
from cli.param.file import edited, replace
from cli.param.running import Running, Values
from services.runtime.errors import Invalid
from services.runtime.params.load import parse, read_text


def save(
    options: Options,
    file: Annotated[Path, Arg("The file to bring up to date.")] = DEFAULT_FILE,
) -> None:
    """Write what the running system has into a parameter file; comments and order stay.

    Only what differs from what the file says, or leaves at its default, is touched. Of one of
    several vehicles it goes into a table of its own.

    Example: quadctl param save
    """
    said = file_values(file, options)
    with Running(options) as running:
        now = running.whole()
    known = known_of(said, now)
    # A command that the file names and the run does not have was added since: it stays.
    found = [change for change in changes(known, now) if change.name in now]
    if found:
        own = f"{options.vehicle}." if len(options.vehicles) > 1 else ""
        text = edited(read_text(file), {own + change.name: change.after for change in found})
        _verify(text, said | {change.name: change.after for change in found}, file, options)
        replace(file, text.encode())
    if options.json:
        output.document({"file": str(file), "changed": [change.document() for change in found]})
    else:
        lines(found)


def _verify(text: str, wanted: Values, file: Path, options: Options) -> None:
    """Hold that the new text says what it shall; raises Invalid, the file being untouched."""
    if values_of(parse(text, str(file)), str(file), options) != wanted:
        raise Invalid(
            f"{file} cannot be changed in place, or was changed meanwhile; it is untouched",
            "`quadctl param dump -o FILE` writes a new one",
        )
