"""Who belongs to the fleet: as a file says, or who is on the hub."""

import os
import re
from pathlib import Path
from typing import Annotated

from cli import output
from cli.declare import Opt
from cli.fleet import file as fleet_file
from cli.fleet.file import Fleet, Member
from cli.fleet.hubs import Hubs
from cli.options import Options
from services.runtime import realm, vehicles
from services.runtime.errors import Unreachable, UsageError
from services.runtime.realm import Realm

File = Annotated[
    Path | None, Opt("The fleet's file (default: ./fleet.toml if it is there).", ("--fleet",))
]
"""The option that every command of the fleet has."""


def fleet_of(options: Options, file: Path | None, hubs: Hubs) -> Fleet:
    """The fleet of a file; where there is none, all vehicles of the hub.

    Raises Invalid for what is wrong with the file, Unreachable where nobody is there.
    """
    _check_for_all(options)
    if file is None and not fleet_file.DEFAULT.exists():
        return Fleet(_on_the_hub(options, hubs), {})
    fleet = fleet_file.read(file or fleet_file.DEFAULT, options.connect)
    if file is None and not options.json and (left := left_out(options, fleet)):
        be = "is" if len(left) == 1 else "are"
        output.note(
            f"from {fleet.source}; {realm.listed(left)}, which {be} live on this hub, {be} not in it"
        )
    return fleet


def left_out(options: Options, fleet: Fleet) -> list[str]:
    """The vehicles of the realm's run, if it has one, that are not in the fleet."""
    if options.connect:
        return []
    ours = ("", Realm(options.realm).endpoint)
    named = {member.vehicle for member in fleet.members if member.connect in ours}
    return [name for name in vehicles.in_run(options.realm) if name not in named]


def _on_the_hub(options: Options, hubs: Hubs) -> list[Member]:
    names = set(vehicles.of(options.realm, options.connect, options.timeout))
    if not options.connect:
        # The run's record names those too whose processes are away, but nobody that came besides.
        any_ = next(iter(names), realm.DEFAULT)
        names |= set(hubs.client("", any_, options.timeout).vehicles())
    if not names:
        raise Unreachable("no vehicle is on the hub", "`quadctl up` starts one")
    return [Member(name, options.connect, name) for name in sorted(names, key=_in_order)]


def _in_order(name: str) -> list[tuple[int, str]]:
    """`uav10` after `uav9`."""
    return [(int(part or 0), text) for text, part in re.findall(r"(\D*)(\d*)", name)]


def _check_for_all(options: Options) -> None:
    # Set for a whole shell, it is no reason to stop one vehicle alone.
    if options.named and options.named != os.environ.get("QUADCTL_VEHICLE"):
        raise UsageError(
            f"--vehicle {options.named}: a command of the fleet is for all of it",
            "leave `fleet` out for one vehicle, or name those you mean in a file for --fleet",
        )
