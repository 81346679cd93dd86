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
    """Make the keys of a fleet: who has the folder says who belongs to it.

    Example: quadctl keys init
    """
    from quadctl.services.runtime.security.registry import Registry

    Registry(fleet).init()
    text = f"a new fleet; keep {fleet} to yourself: who has it can be anybody"
    output.either(options, {"fleet": str(fleet)}, text)


def list_(options: Options, fleet: Folder = FLEET) -> None:
    """List who belongs to the fleet, as what, for which vehicles, and until when.

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
    """A name as JSON has it, its certificate's own name beside it."""
    said: dict[str, Any] = msgspec.to_builtins(name)
    return said | {"certificate": name.common_name}


def day(stamp: float, *, expired: bool = False) -> str:
    """A Unix time (s) on this machine's clock; where asked for, that it has passed."""
    text = time.strftime("%Y-%m-%d %H:%M", time.localtime(stamp))
    return f"{text} (expired)" if expired and stamp <= time.time() else text


def revoke(options: Options, name: Annotated[str, Arg("Whose.")], fleet: Folder = FLEET) -> None:
    """Take somebody's certificate from the list that hubs go by; those that run know in 2 s.

    A hub on another machine knows it once it has the new names.json of its folder.

    Example: quadctl keys revoke anna
    """
    from quadctl.services.runtime.security.registry import Registry

    gone = Registry(fleet).revoke(name)
    output.either(options, shown(gone), f"{gone.common_name} is good no more")


_MOST_DAYS = 3650


def issue(
    options: Options,
    role: Annotated[str, Arg("hub, vehicle, safety, operator, observer or student.")],
    name: Annotated[str | None, Arg("Whose it is (default: the vehicle's, or the role's).")] = None,
    vehicles: Annotated[
        int | None, Option("One for each of so many vehicles: uav0, uav1 ..", metavar="N")
    ] = None,
    days: Annotated[float, Option("How long it is good.")] = 30.0,
    host: Annotated[
        list[str] | None,
        Option("A hub's address or name (default: this machine's).", metavar="HOST"),
    ] = None,
    fleet: Folder = FLEET,
) -> None:
    """Issue a certificate for one vehicle, for each of several, or for all where none is said.

    Whoever had the name before has it no more.

    Example: quadctl keys issue student anna --vehicle uav7
    """
    from quadctl.services.runtime.security.registry import Registry, checked, checked_vehicles

    known = _known(role)
    if not 0 < days <= _MOST_DAYS:
        raise UsageError(f"--days {days:g}: not a time", f"give more than 0, up to {_MOST_DAYS}")
    if host and role != "hub":
        raise UsageError(f"--host is where a hub is reached, and a {role} is not")
    if vehicles is not None:
        if name:
            raise UsageError(f"{name}: with --vehicles each is called as its vehicle")
        wanted = {each: [each] for each in names(options.named or DEFAULT, vehicles)}
    else:
        whose = checked(name or options.named or role)
        wanted = {whose: checked_vehicles([options.named] if options.named else [])}
    keeper = Registry(fleet)
    made = keeper.issue(known, wanted, days, host or [])
    said = [shown(one) | {"folder": str(keeper.folder_of(one))} for one in made]
    if options.json:
        output.document(said if vehicles is not None else said[0])
        return
    for one in made:
        until = f"good until {day(one.expires)}"
        output.line(f"{keeper.folder_of(one)}: {one.common_name}, for {one.of}, {until}")


def _known(role: str) -> Role:
    roles = get_args(Role)
    if role not in roles:
        raise UsageError(f"{role} is no role", nearest(role, roles) or f"one of {', '.join(roles)}")
    return cast("Role", role)
