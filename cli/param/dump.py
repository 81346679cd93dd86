"""`param dump`: the running system's parameters as a file."""

from pathlib import Path
from typing import Annotated

from cli import output
from cli.declare import Arg, Opt
from cli.options import Options
from cli.param.changes import file_values, known_of
from cli.param.running import Running
from services.runtime.files import write_new
from services.runtime.params import catalogue


def dump(
    options: Options,
    names: Annotated[
        list[str] | None, Arg("Parameters, or whole tables (default: all).", complete="param")
    ] = None,
    file: Annotated[
        Path | None, Opt("Write it there instead of to stdout.", ("--output", "-o"), "FILE")
    ] = None,
) -> None:
    """Print the running system's parameters as TOML, for `up FILE` or `param load FILE`.

    Example: quadctl param dump -o tuned.toml
    """
    with Running(options) as running:
        values = running.get(names) if names else running.whole()
    if not names:
        known_of(file_values(None, options), values)
    text = catalogue.document(values)
    if file is not None:
        write_new(file, text)
        output.either(options, {"file": str(file)}, f"wrote {file}")
    elif options.json:
        output.document(values)
    else:
        output.line(text.rstrip("\n"))
