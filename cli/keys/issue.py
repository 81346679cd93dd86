"""`keys issue`: a certificate for somebody."""

from pathlib import Path
from typing import Annotated, get_args

from cli import output
from cli.declare import Arg, Opt
from cli.keys.init import FLEET
from cli.keys.list import day, shown
from cli.options import Options
from schemas.roles import Role
from services.runtime.errors import UsageError
from services.runtime.named import nearest

_MOST_DAYS = 3650


def issue(
    options: Options,
    role: Annotated[str, Arg("hub, vehicle, safety, operator, observer or student.")],
    name: Annotated[str | None, Arg("Whose it is (default: the vehicle's, or the role's).")] = None,
    days: Annotated[float, Opt("How long it is good.")] = 30.0,
    host: Annotated[
        list[str] | None,
        Opt("A hub's address or name (default: this machine's).", metavar="HOST"),
    ] = None,
    fleet: Annotated[Path, Opt("The folder of the fleet's keys.")] = FLEET,
) -> None:
    """Issue a certificate for one vehicle, or with no --vehicle for all.

    Whoever had the name before has it no more.

    Example: quadctl keys issue student anna --vehicle uav7
    """
    from services.runtime.secure.fleet import Fleet
    from services.runtime.secure.names import checked, checked_vehicles

    for known in get_args(Role):
        if known == role:
            break
    else:
        roles = get_args(Role)
        hint = nearest(role, roles) or f"one of {', '.join(roles)}"
        raise UsageError(f"{role} is no role", hint)
    if not 0 < days <= _MOST_DAYS:
        raise UsageError(f"--days {days:g}: not a time", f"give more than 0, up to {_MOST_DAYS}")
    if host and role != "hub":
        raise UsageError(f"--host is where a hub is reached, and a {role} is not")
    vehicles = checked_vehicles([options.named] if options.named else [])
    whose = checked(name or options.named or role)
    made, folder = Fleet(fleet).issue(known, whose, vehicles, days, host or [])
    text = f"{folder}: {made.common_name}, for {made.of}, good until {day(made.expires)}"
    output.either(options, shown(made) | {"folder": str(folder)}, text)
