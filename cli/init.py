"""`init`: the parameter file."""

from pathlib import Path
from typing import Annotated

import typer

from cli import options, output
from services.runtime.errors import Invalid, QuadctlError

_DEFAULT_FILE = Path("quad.toml")


def init(ctx: typer.Context, file: Annotated[Path, typer.Argument()] = _DEFAULT_FILE) -> None:
    """Write the parameter file with every key, its unit, default and meaning.

    Example: quadctl init my_lab.toml
    """
    from services.runtime.template import render

    chosen = options.of(ctx)
    try:
        with file.open("x", encoding="utf-8") as out:
            out.write(render())
    except FileExistsError as error:
        raise Invalid(f"{file} is there already", "name another file, or remove it") from error
    except OSError as error:
        raise QuadctlError(f"{file} cannot be written: {error.strerror}") from error
    if chosen.json:
        output.document({"file": str(file)})
    else:
        output.line(f"wrote {file}")
