"""`keys revoke`: a certificate that is good no more."""

from pathlib import Path
from typing import Annotated

from cli import output
from cli.declare import Arg, Opt
from cli.keys.init import FLEET
from cli.keys.list import shown
from cli.options import Options


def revoke(
    options: Options,
    name: Annotated[str, Arg("Whose.")],
    fleet: Annotated[Path, Opt("The folder of the fleet's keys.")] = FLEET,
) -> None:
    """Take somebody's certificate from the list that hubs go by; those that run know in 2 s.

    A hub on another machine knows it once it has the new names.json of its folder.

    Example: quadctl keys revoke anna
    """
    from services.runtime.security.registry import Fleet

    gone = Fleet(fleet).revoke(name)
    output.either(options, shown(gone), f"{gone.common_name} is good no more")
