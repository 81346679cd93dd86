"""`bag repair`: makes a cut recording whole."""

import os
from pathlib import Path
from typing import Annotated

from cli import output
from cli.bag.info import Recording
from cli.declare import Opt
from cli.options import Options
from services.runtime.errors import QuadctlError
from services.runtime.files import taken
from services.runtime.recording import verify as mending


def repair(
    options: Options,
    file: Recording,
    target: Annotated[
        Path | None, Opt("Write there, and leave FILE as it is.", ("-o", "--output"))
    ] = None,
) -> None:
    """Make a recording whole that was cut: by kill -9, a full disk, or half a copy.

    All whole chunks are kept; a recorder that was killed has lost at most half a second.

    Example: quadctl bag repair flight.mcap
    """
    fresh = target or file.with_name(f".{file.name}.{os.getpid()}")
    try:
        done = mending.repair(file, fresh)
        if target is None:
            fresh.replace(file)
    except FileExistsError as error:
        raise taken(fresh) from error
    except OSError as error:
        raise QuadctlError(
            f"{fresh} cannot be written: {error.strerror}", "make room, or name another place: -o"
        ) from error
    said = {"file": str(target or file), "messages": done.messages, "dropped_bytes": done.dropped}
    if not done.why:
        output.either(options, {**said, "cut": ""}, f"{file} was whole: {done.messages} messages")
        return
    output.either(
        options,
        {**said, "cut": done.why},
        f"{target or file}: {done.messages} messages kept, {done.dropped} bytes of a torn end dropped",
    )
