"""`keys init`, `issue`, `list` and `revoke`."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast, get_args

import msgspec

from quadctl.cli import output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg, Option
from quadctl.schemas.roles import Role
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.params.load import names
from quadctl.services.runtime.params.names import nearest
from quadctl.services.runtime.realm import DEFAULT

if TYPE_CHECKING:
    from quadctl.services.runtime.security.identity import Name

FLEET = Path("keys")
Folder = Annotated[Path, Option("The folder of the fleet's keys.")]


def init(options: Options, fleet: Folder = FLEET) -> None:
    """Make the keys of a fleet; the owner of their folder decides who belongs to it.

    Example: quadctl keys init
    """
    from quadctl.services.runtime.security.registry import Registry

    Registry(fleet).init()
    text = f"a new fleet; keep {fleet} secret: anyone who has it can act as any member"
    output.either(options, {"fleet": str(fleet)}, text)


def list_(options: Options, fleet: Folder = FLEET) -> None:
    """List the members of the fleet, with role, vehicles and expiry.

    Example: quadctl keys list
    """
    from quadctl.services.runtime.security.registry import Registry

    known = sorted(Registry(fleet).names(), key=lambda name: (name.role, name.name))
    if options.json:
        output.document([shown(name) for name in known])
        return
    rows = (
        (each.name, each.role, each.of, each.serial, day(each.expires, expired=True))
        for each in known
    )
    output.table([("NAME", "ROLE", "VEHICLES", "SERIAL", "GOOD UNTIL"), *rows])


def shown(name: "Name") -> dict[str, Any]:
    """Return a name for JSON, with the name in its certificate."""
    fields: dict[str, Any] = msgspec.to_builtins(name)
    return fields | {"certificate": name.common_name}


def day(stamp: float, *, expired: bool = False) -> str:
    """Return a Unix time (s) as local time; with `expired`, note if it has passed."""
    text = time.strftime("%Y-%m-%d %H:%M", time.localtime(stamp))
    return f"{text} (expired)" if expired and stamp <= time.time() else text


def revoke(
    options: Options, name: Annotated[str, Arg("Name to revoke.")], fleet: Folder = FLEET
) -> None:
    """Revoke a certificate; running hubs refuse it within 2 s.

    A hub on another machine refuses it once it has the new names.json in its folder.

    Example: quadctl keys revoke anna
    """
    from quadctl.services.runtime.security.registry import Registry

    gone = Registry(fleet).revoke(name)
    output.either(options, shown(gone), f"{gone.common_name} is revoked")


_MOST_DAYS = 3650


def issue(
    options: Options,
    role: Annotated[str, Arg("hub, vehicle, safety, operator, observer or student.")],
    name: Annotated[str | None, Arg("Its name (default: the vehicle's, or the role's).")] = None,
    vehicles: Annotated[
        int | None, Option("Issue one for each of N vehicles: uav0, uav1 ..", metavar="N")
    ] = None,
    days: Annotated[float, Option("Days until it expires.")] = 30.0,
    host: Annotated[
        list[str] | None,
        Option("A hub's address or name (default: this machine's).", metavar="HOST"),
    ] = None,
    fleet: Folder = FLEET,
) -> None:
    """Issue a certificate for one vehicle, for each of several, or for all if none is named.

    An earlier certificate of the same name is revoked.

    Example: quadctl keys issue student anna --vehicle uav7
    """
    from quadctl.services.runtime.security.registry import Registry, checked, checked_vehicles

    roles = get_args(Role)
    if role not in roles:
        raise UsageError(f"{role} is no role", nearest(role, roles) or f"one of {', '.join(roles)}")
    if not 0 < days <= _MOST_DAYS:
        raise UsageError(f"--days {days:g}: not a time", f"give more than 0, up to {_MOST_DAYS}")
    if host and role != "hub":
        raise UsageError(f"--host is the address of a hub, and a {role} has none")
    if vehicles is not None:
        if name:
            raise UsageError(f"{name}: with --vehicles each has the name of its vehicle")
        wanted = {each: [each] for each in names(options.named or DEFAULT, vehicles)}
    else:
        owner = checked(name or options.named or role)
        wanted = {owner: checked_vehicles([options.named] if options.named else [])}
    registry = Registry(fleet)
    made = registry.issue(cast("Role", role), wanted, days, host or [])
    if options.json:
        documents = [shown(one) | {"folder": str(registry.folder_of(one))} for one in made]
        output.document(documents if vehicles is not None else documents[0])
        return
    for one in made:
        until = f"good until {day(one.expires)}"
        output.line(f"{registry.folder_of(one)}: {one.common_name}, for {one.of}, {until}")
