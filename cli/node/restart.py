"""`node restart`: has the supervisor start processes anew."""

import time
from typing import Annotated

from cli import output, which
from cli.declare import Arg, Opt
from cli.options import Options, here
from services.runtime import run_files
from services.runtime.errors import TimedOut, UsageError
from services.runtime.params.names import normal_name
from services.runtime.realm import Realm
from services.runtime.supervisor.control import ask_restart, wait_restarted


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
        [node.name for node in run_files.read(realm).nodes]
        if everything
        else [normal_name(which.about_node(options, name)[1]) for name in names or []]
    )
    deadline = time.monotonic() + options.timeout
    asked = [ask_restart(realm, name) for name in wanted]
    for before in asked:
        left = max(deadline - time.monotonic(), 0.0)
        try:
            after = wait_restarted(realm, before.name, before, left)
        except TimedOut as problem:
            raise _late(realm, before.name, options.timeout, problem.hint) from problem
        said = {"name": after.name, "before": before.pid, "pid": after.pid}
        text = f"{after.name}: process {after.pid} in place of {before.pid or 'none'}"
        output.either(options, said, text)


def _late(realm: Realm, name: str, timeout: float, hint: str) -> TimedOut:
    """Why a process is not back within the time (s) that was given for all of them."""
    run = run_files.read(realm)
    if (realm.asked / name).exists():
        # The request still lies where the supervisor takes it from.
        return TimedOut(
            f"{name} was not restarted: the supervisor, process {run.pid}, did not answer within"
            f" {timeout:g} s",
            f"it is frozen or busy, and restarts {name} once it goes on: `quadctl status`",
        )
    state = next((node.state for node in run.nodes if node.name == name), "down")
    return TimedOut(f"{name} is not ready again within {timeout:g} s, but {state}", hint)
