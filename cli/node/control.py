"""`node restart` and `node kill`."""

import os
import signal
import sys
import time
from typing import Annotated

from quadctl.cli import context, output
from quadctl.cli.context import Options, require_local
from quadctl.cli.declarations import Arg, Option
from quadctl.services.runtime import run_files
from quadctl.services.runtime.errors import TimedOut, Unreachable, UsageError
from quadctl.services.runtime.params.names import nearest, normal_name
from quadctl.services.runtime.procfs import is_frozen, parent_of
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import ProcessRecord, RunState
from quadctl.services.runtime.supervisor.control import request_restart, wait_restarted


def restart(
    options: Options,
    names: Annotated[list[str] | None, Arg("Nodes.", complete="node")] = None,
    everything: Annotated[bool, Option("Every process of the run.", ("--all",))] = False,
) -> None:
    """Restart processes, also those left down, and wait until they are ready.

    Example: quadctl node restart pressure
    """
    require_local(options, "node restart")
    if bool(names) == everything:
        raise UsageError("node restart takes the nodes' names, or --all")
    context.check_vehicle(options)
    realm = Realm(options.realm)
    wanted = (
        [node.name for node in run_files.read(realm).nodes]
        if everything
        else [normal_name(context.about_node(options, name)[1]) for name in names or []]
    )
    deadline = time.monotonic() + options.timeout
    requested = [request_restart(realm, name) for name in wanted]
    for before in requested:
        left = max(deadline - time.monotonic(), 0.0)
        try:
            after = wait_restarted(realm, before.name, before, left)
        except TimedOut as problem:
            raise _late(realm, before.name, options.timeout, problem.hint) from problem
        document = {"name": after.name, "before": before.pid, "pid": after.pid}
        text = f"{after.name}: process {after.pid} in place of {before.pid or 'none'}"
        output.either(options, document, text)


def _late(realm: Realm, name: str, timeout: float, hint: str) -> TimedOut:
    """Return the error for a process that is not back within the time (s) given for all."""
    run = run_files.read(realm)
    if (realm.restart_requests / name).exists():
        # The supervisor has not taken the request yet.
        return TimedOut(
            f"{name} was not restarted: the supervisor, process {run.pid}, did not answer within"
            f" {timeout:g} s",
            f"it is frozen or busy, and restarts {name} once it goes on: `quadctl status`",
        )
    state = next((node.state for node in run.nodes if node.name == name), "down")
    return TimedOut(f"{name} is not ready again within {timeout:g} s, but {state}", hint)


_DONE = {
    "KILL": ("killed", "restarts it"),
    "TERM": ("asked to end", "restarts it"),
    "INT": ("interrupted", "restarts it"),
    "STOP": ("stopped", "restarts what does not answer"),
    "CONT": ("continued", ""),
}
"""Effect of each signal, and the reaction of the supervisor."""
_BACK = "`quadctl status` shows when it is back"


def kill(
    options: Options,
    names: Annotated[list[str], Arg("Nodes.", complete="node")],
    number: Annotated[
        str, Option("KILL, TERM, INT, STOP or CONT.", ("--signal",), "SIGNAL")
    ] = "TERM",
) -> None:
    """Send a signal to processes that `up` supervises; it restarts those that end.

    If one of several processes is missing, none gets the signal.

    Example: quadctl node kill pressure --signal KILL
    """
    signal_ = number.upper().removeprefix("SIG")
    if signal_ not in _DONE or not hasattr(signal, f"SIG{signal_}"):
        raise UsageError(f"--signal {number}: no such signal", f"one of {', '.join(_DONE)}")
    run = _run(options)
    effect = _effect(signal_, run.pid if is_frozen(run.pid) else 0)
    own = [normal_name(context.about_node(options, name)[1]) for name in names]
    for process in [_process(run, name) for name in dict.fromkeys(own)]:
        _send(process, signal_)
        document = {"name": process.name, "pid": process.pid, "signal": signal_}
        output.either(options, document, f"{process.name} (process {process.pid}): {effect}")


def _effect(signal_: str, frozen: int) -> str:
    """Return the effect of a signal; `frozen` is the pid of a frozen supervisor, else 0."""
    done, then = _DONE[signal_]
    if frozen and then:
        return f"{done}; the supervisor, process {frozen}, is frozen and {then} once it goes on"
    return f"{done}; the supervisor {then}" if then else done


def signalled(options: Options, name: str, signal_: str) -> None:
    """Send a signal, e.g. KILL, to a node's process; raise Unreachable if there is none."""
    _send(_process(_run(options), name), signal_)


def _run(options: Options) -> RunState:
    require_local(options, "node kill")
    context.check_vehicle(options)
    return run_files.read(Realm(options.realm))


def _process(run: RunState, name: str) -> ProcessRecord:
    by_name = {process.name: process for process in run.nodes}
    if name not in by_name:
        hint = nearest(name, by_name) or "end a node started by hand where you started it"
        raise Unreachable(f"`up` supervises no process {name} in the realm {run.realm}", hint)
    process = by_name[name]
    # The number of a recorded process that has just ended may now be a foreign process's.
    parent = parent_of(process.pid) if process.pid else None
    if not process.pid or (parent != run.pid and sys.platform == "linux"):
        raise Unreachable(f"{process.name} has no process now: it is {process.state}", _BACK)
    return process


def _send(process: ProcessRecord, signal_: str) -> None:
    number = getattr(signal, f"SIG{signal_}")
    try:
        if sys.platform == "win32":
            os.kill(process.pid, number)
        else:
            # As in the supervisor, the group: a process and its children.
            os.killpg(process.pid, number)
    except ProcessLookupError as error:
        raise Unreachable(f"{process.name} has just ended", _BACK) from error
