"""`keys list`: whose certificates are good."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from cli import output
from cli.declare import Opt
from cli.keys.init import FLEET
from cli.options import Options

if TYPE_CHECKING:
    from services.runtime.security.identity import Name


def list_(
    options: Options, fleet: Annotated[Path, Opt("The folder of the fleet's keys.")] = FLEET
) -> None:
    """List who belongs to the fleet, as what, for which vehicles, and until when.

    Example: quadctl keys list
    """
    from services.runtime.security.registry import Fleet

    known = sorted(Fleet(fleet).names(), key=lambda name: (name.role, name.name))
    if options.json:
        output.document([shown(name) for name in known])
        return
    rows = (
        (each.name, each.role, each.of, each.serial, day(each.expires, expired=True))
        for each in known
    )
    output.table([("NAME", "ROLE", "VEHICLES", "SERIAL", "GOOD UNTIL"), *rows])


def shown(name: "Name") -> dict[str, Any]:
    """A name as JSON has it, its certificate's own name beside it."""
    said: dict[str, Any] = msgspec.to_builtins(name)
    return said | {"certificate": name.common_name}


def day(stamp: float, *, expired: bool = False) -> str:
    """A Unix time (s) on this machine's clock; where asked for, that it has passed."""
    text = time.strftime("%Y-%m-%d %H:%M", time.localtime(stamp))
    return f"{text} (expired)" if expired and stamp <= time.time() else text
