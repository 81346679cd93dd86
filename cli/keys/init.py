"""`keys init`: a fleet's own certificate authority."""

from pathlib import Path
from typing import Annotated

from cli import output
from cli.declare import Opt
from cli.options import Options

FLEET = Path("keys")


def init(
    options: Options, fleet: Annotated[Path, Opt("The folder of the fleet's keys.")] = FLEET
) -> None:
    """Make the keys of a fleet: who has the folder says who belongs to it.

    Example: quadctl keys init
    """
    from services.runtime.security.registry import Fleet

    Fleet(fleet).init()
    text = f"a new fleet; keep {fleet} to yourself: who has it can be anybody"
    output.either(options, {"fleet": str(fleet)}, text)
