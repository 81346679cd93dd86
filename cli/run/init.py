"""`init`: the parameter file."""

from pathlib import Path
from typing import Annotated

from cli import output
from cli.declare import Arg
from cli.options import Options
from services.runtime.files import write_new
from services.runtime.params.catalogue import render

_DEFAULT_FILE = Path("quad.toml")


def init(
    options: Options, file: Annotated[Path, Arg("Where to write it.")] = _DEFAULT_FILE
) -> None:
    """Write the parameter file with every key, its unit, default and meaning.

    Example: quadctl init my_lab.toml
    """
    write_new(file, render())
    output.either(options, {"file": str(file)}, f"wrote {file}")
