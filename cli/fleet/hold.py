"""`fleet hold`: all vehicles stop."""

from cli import output
from cli.fleet.file import Member
from cli.fleet.hubs import Hubs
from cli.fleet.members import File, fleet_of
from cli.fleet.told import fail, row
from cli.options import Options
from schemas.services import HoldRequest
from schemas.topics import HOLD
from services.runtime.bus.client import Client


def hold(options: Options, file: File = None) -> None:
    """Stop all vehicles at once, each hovering at its stopping point.

    A hub that is away delays none of the others. 0 only where all have stopped, else the code of
    the worst: nobody answers (3) before a timeout (4) before a refusal (5).

    Example: quadctl fleet hold --fleet fleet.toml
    """
    with Hubs(options) as hubs:
        members = fleet_of(options, file, hubs).members
        heard = hubs.ask(members, _stop, bounded=True)
    if options.json:
        output.document(
            [
                row(m, options, heard.problems.get(m.name), stopped=m.name in heard.answers)
                for m in members
            ]
        )
    else:
        for name in heard.answers:
            output.line(f"{name}: stopping: hovering at the stopping point")
    fail(heard.problems)


def _stop(_member: Member, client: Client) -> bool:
    return client.call(HOLD, HoldRequest()).success
