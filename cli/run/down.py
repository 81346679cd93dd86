"""`down`: ends the run of a realm."""

from cli import output
from cli.options import Options, here
from services.runtime.realm import Realm
from services.runtime.supervisor.control import halt


def down(options: Options) -> None:
    """Stop the run of a realm and all of its processes.

    Example: quadctl down
    """
    here(options, "down")
    run = halt(Realm(options.realm), options.timeout)
    said = {"realm": options.realm, "pid": run.pid}
    output.either(options, said, f"realm {options.realm} is down")
