"""`node restart`: has the supervisor start processes anew."""

import time
from typing import Annotated

from cli import output, which
from cli.declare import Arg, Opt
from cli.options import Options, here
from services.runtime import record
from services.runtime.errors import UsageError
from services.runtime.realm import Realm
from services.runtime.run.asking import ask_restart, wait_restarted
from services.runtime.settings.named import normal_name


def restart(
    options: Options,
    names: Annotated[list[str] | None, Arg("Nodes.", complete="node")] = None,
    everything: Annotated[bool, Opt("Every process of the run.", ("--all",))] = False,
) -> None:
    """Start processes anew, also one that is left down, and wait until they are ready.

    Example: quadctl node restart pressure
    """
    here(options, "node restart")
    if bool(names) == everything:
        raise UsageError("node restart takes the nodes' names, or --all")
    realm = Realm(options.realm)
    wanted = (
        [node.name for node in record.read(realm).nodes]
        if everything
        else [normal_name(which.about_node(options, name)[1]) for name in names or []]
    )
    deadline = time.monotonic() + options.timeout
    asked = [ask_restart(realm, name) for name in wanted]
    for before in asked:
        left = max(deadline - time.monotonic(), 0.0)
        after = wait_restarted(realm, before.name, before, left)
        said = {"name": after.name, "before": before.pid, "pid": after.pid}
        text = f"{after.name}: process {after.pid} in place of {before.pid or 'none'}"
        output.either(options, said, text)
