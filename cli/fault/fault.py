"""`fault list`, `inject` and `clear`."""

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg
from quadctl.cli.fault.catalogue import BUS_CUT, FAULTS, OF_PROCESSES, Fault, active
from quadctl.cli.node.control import signalled
from quadctl.cli.node.lookup import run_of
from quadctl.schemas.services import GetParamsRequest, SetParamsRequest
from quadctl.schemas.topics import get_params, set_params
from quadctl.services.runtime import procfs, run_files
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.params.names import flatten, nearest
from quadctl.services.runtime.process_table import NODES
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import RunState

if TYPE_CHECKING:
    # `status` uses this module, and importing Zenoh takes longer than the whole command.
    from quadctl.services.runtime.bus.client import Client


def running_values(options: Options) -> dict[str, Any]:
    """Return the vehicle's parameters, with --connect from its nodes."""
    if not options.connect:
        context.check_vehicle(options)
        realm = Realm(options.realm)
        run_files.read(realm)
        return values_of(realm, options.vehicle)
    with context.connect(options) as client:
        replies = [
            client.call(get_params(node), GetParamsRequest([])) for node in ("dynamics", "pressure")
        ]
    return {name: value for reply in replies for name, value in reply.values.items()}


def values_of(realm: Realm, vehicle: str) -> dict[str, Any]:
    """Return a vehicle's parameters from the realm's folder."""
    return dict(flatten(run_files.tables(realm, vehicle)))


def frozen(options: Options) -> list[str]:
    """Return the processes of the run that a signal has stopped, e.g. `safety-frozen`."""
    run = run_of(options)
    return frozen_of(run) if run else []


def frozen_of(run: RunState) -> list[str]:
    """Return the processes of a given run that a signal has stopped."""
    return [f"{node.name}-frozen" for node in run.nodes if node.pid and procfs.is_frozen(node.pid)]


def list_(options: Options) -> None:
    """List the faults, and show which of them are in.

    Example: quadctl fault list
    """
    values = running_values(options)
    stopped = frozen(options)
    injected = {*active(values), *stopped, *(BUS_CUT for name in stopped if _cut(name))}
    rows = [(fault.name, fault.about) for fault in FAULTS]
    rows += [(f"NODE-{name}", about) for name, (_, about) in OF_PROCESSES.items()]
    rows.append((BUS_CUT, "no message reaches any node: the hub is frozen"))
    rows += [(name, "it is stopped by a signal") for name in sorted(injected - dict(rows).keys())]
    if options.json:
        table = [{"name": name, "about": about, "active": name in injected} for name, about in rows]
        output.document(table)
        return
    marked = (("in" if name in injected else "-", name, about) for name, about in rows)
    output.table([("", "FAULT", "WHAT IT DOES"), *marked])


def inject(
    options: Options,
    name: Annotated[str, Arg("A fault of `fault list`; for NODE-killed e.g. safety-killed.")],
    size: Annotated[float | None, Arg("Its SIZE, as `fault list` explains it.")] = None,
) -> None:
    """Put a fault in: a parameter of the simulation, or a signal to a process.

    `fault clear` takes it out, and its size, too.

    Example: quadctl fault inject barometer-glitch 5
    """
    gone = ""
    node, _, what = name.rpartition("-")
    if name == BUS_CUT:
        node, what = "hub", "frozen"
    if node in _processes(options) and what in OF_PROCESSES:
        if size is not None:
            raise _without_size(name)
        signalled(options, node, OF_PROCESSES[what][0])
    else:
        fault = _named(name)
        if size is not None and not fault.size:
            raise _without_size(name)
        if size == fault.sound:
            raise Invalid(f"{name} {size:g} is no fault", "`quadctl fault clear` takes it out")
        launched = _launched(options)
        with context.connect(options) as client:
            gone = _put(client, fault, size, launched)
    text = f"{name} is in" + (f", in place of {gone}" if gone else "")
    output.either(options, {"injected": name}, text)


def _without_size(name: str) -> UsageError:
    return UsageError(f"{name} has no size", "`quadctl fault list` shows which faults have a SIZE")


def clear(
    options: Options, name: Annotated[str, Arg("A fault (default: all that are in).")] = ""
) -> None:
    """Take a fault out, or all of them; a frozen process goes on.

    Example: quadctl fault clear
    """
    changes: list[tuple[Fault, dict[str, Any]]] = []
    if name:
        of_process = name == BUS_CUT or name.removesuffix("-frozen") in _processes(options)
        named = [] if of_process else [_named(name)]
    else:
        values, launched = running_values(options), _launched(options)
        named = [fault for fault in FAULTS if fault.name in active(values)]
        # A fault that another one replaced has left its size; with --connect the launch is unknown.
        for fault in () if options.connect or not values else FAULTS:
            size = fault.former_size(launched)
            is_changed = any(values.get(name) != number for name, number in size.items())
            if is_changed and fault.size != fault.parameter:
                changes.append((fault, size))
    thawed = [found for found in frozen(options) if name in {"", found, *_cut(found)}]
    for found in thawed:
        signalled(options, found.removesuffix("-frozen"), "CONT")
    if named:
        launched = _launched(options)
        changes += [(fault, fault.cleared(launched)) for fault in named]
    if changes:
        with context.connect(options) as client:
            for fault, sound in changes:
                _set(client, fault, sound)
    gone = [*thawed, *(fault.name for fault in named)]
    text = "\n".join(f"{one} is out" for one in gone) or "no fault is in"
    output.either(options, {"cleared": gone}, text)


def _launched(options: Options) -> dict[str, Any]:
    """Return the parameters of the launch, with --connect the defaults: the file is elsewhere."""
    if options.connect:
        from msgspec import to_builtins

        from quadctl.schemas.params import Params

        return dict(flatten(to_builtins(Params())))
    return dict(flatten(run_files.launch_tables(Realm(options.realm), options.vehicle)))


def _processes(options: Options) -> set[str]:
    """Return the processes that may be killed or frozen: the lab's, and those of a run here."""
    run = run_of(options)
    return {*NODES, *(node.name for node in (run.nodes if run else ()))}


def _put(client: "Client", fault: Fault, size: float | None, launched: Mapping[str, Any]) -> str:
    """Put a fault in and return the one that it replaces: a parameter causes one at a time."""
    ends = time.monotonic() + client.timeout
    values = client.call(get_params(fault.node), GetParamsRequest([fault.parameter])).values
    former = next((f for f in FAULTS if f.name in active(values) and f.name != fault.name), None)
    wanted = (former.former_size(launched) if former else {}) | fault.values(size)
    _set(client, fault, wanted, max(ends - time.monotonic(), 0.001))
    return former.name if former else ""


def _set(
    client: "Client", fault: Fault, values: dict[str, Any], timeout: float | None = None
) -> None:
    request = SetParamsRequest(values)
    reply = client.call(set_params(fault.node), request, timeout)
    if not reply.success:
        reason = reply.reason.removeprefix("param set: ")
        raise Invalid(f"nothing was changed: {reason}", "`quadctl fault list` explains each SIZE")


def _cut(found: str) -> set[str]:
    return {BUS_CUT} if found == "hub-frozen" else set()


def _named(name: str) -> Fault:
    known = {fault.name: fault for fault in FAULTS}
    if name not in known:
        like = nearest(name, [*known, BUS_CUT])
        hint = "; ".join(filter(None, (like, "`quadctl fault list` shows all")))
        raise UsageError(f"there is no fault {name}", hint)
    return known[name]
