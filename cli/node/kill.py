"""`node kill`: sends a signal to a process of this realm."""

import os
import signal
import sys
from typing import Annotated

from cli import output, which
from cli.declare import Arg, Opt
from cli.options import Options, here
from services.runtime import run_files
from services.runtime.errors import Unreachable, UsageError
from services.runtime.params.names import nearest, normal_name
from services.runtime.procfs import is_frozen, parent_of
from services.runtime.realm import Realm
from services.runtime.run_files import ProcessRecord, RunRecord

_DONE = {
    "KILL": ("killed", "restarts it"),
    "TERM": ("asked to end", "restarts it"),
    "INT": ("interrupted", "restarts it"),
    "STOP": ("stopped", "restarts what does not answer"),
    "CONT": ("continued", ""),
}
"""What a signal has done, and what the supervisor does then."""


def kill(
    options: Options,
    names: Annotated[list[str], Arg("Nodes.", complete="node")],
    number: Annotated[str, Opt("KILL, TERM, INT, STOP or CONT.", ("--signal",), "SIGNAL")] = "TERM",
) -> None:
    """Send a signal to processes that `up` looks after, and which it restarts when that ends them.

    Where one of several is not there, none gets it.

    Example: quadctl node kill pressure --signal KILL
    """
    signal_ = number.upper().removeprefix("SIG")
    if signal_ not in _DONE or not hasattr(signal, f"SIG{signal_}"):
        raise UsageError(f"--signal {number}: no such signal", f"one of {', '.join(_DONE)}")
    run = _run(options)
    told = _told(signal_, run.pid if is_frozen(run.pid) else 0)
    own = [normal_name(which.about_node(options, name)[1]) for name in names]
    for process in [_process(run, name) for name in dict.fromkeys(own)]:
        _send(process, signal_)
        said = {"name": process.name, "pid": process.pid, "signal": signal_}
        output.either(options, said, f"{process.name} (process {process.pid}): {told}")


def _told(signal_: str, frozen: int) -> str:
    """What comes of a signal; `frozen` is the supervisor's pid where it cannot do anything now."""
    done, then = _DONE[signal_]
    if frozen and then:
        return f"{done}; the supervisor, process {frozen}, is frozen and {then} once it goes on"
    return f"{done}; the supervisor {then}" if then else done


def signalled(options: Options, name: str, signal_: str) -> None:
    """Send a signal, as KILL, to a node's process; raises Unreachable where there is none."""
    _send(_process(_run(options), name), signal_)


def _run(options: Options) -> RunRecord:
    here(options, "node kill")
    return run_files.read(Realm(options.realm))


def _process(run: RunRecord, name: str) -> ProcessRecord:
    by_name = {process.name: process for process in run.nodes}
    if name not in by_name:
        hint = "a node that was started by hand is ended where it was started"
        raise Unreachable(
            f"no process {name} is looked after by `up` in the realm {run.realm}",
            nearest(name, by_name) or hint,
        )
    process = by_name[name]
    # A recorded process that has just ended may have left its number to a stranger's.
    parent = parent_of(process.pid) if process.pid else None
    if not process.pid or (parent != run.pid and sys.platform == "linux"):
        raise Unreachable(
            f"{process.name} has no process now: it is {process.state}",
            "`quadctl status` shows when it is back",
        )
    return process


def _send(process: ProcessRecord, signal_: str) -> None:
    number = getattr(signal, f"SIG{signal_}")
    try:
        if sys.platform == "win32":
            os.kill(process.pid, number)
        else:
            # As the supervisor does: a process and what it has started are one group.
            os.killpg(process.pid, number)
    except ProcessLookupError as error:
        raise Unreachable(
            f"{process.name} has just ended", "`quadctl status` shows when it is back"
        ) from error
