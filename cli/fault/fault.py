"""`fault list`, `inject` and `clear`: what goes wrong, to order."""

import time
from typing import Annotated

from cli import bus, output
from cli.declare import Arg
from cli.fault.catalogue import BUS_CUT, FAULTS, OF_PROCESSES, Fault, active
from cli.fault.kept import frozen, kept
from cli.node.kill import signalled
from cli.options import Options
from schemas.services import GetParamsRequest, SetParamsRequest
from schemas.topics import get_params, set_params
from services.runtime.bus.client import Client
from services.runtime.errors import Invalid, UsageError
from services.runtime.params.names import nearest
from services.runtime.process_table import NODES


def list_(options: Options) -> None:
    """Show the faults that there are, and which of them are in.

    Example: quadctl fault list
    """
    values = kept(options)
    stopped = frozen(options)
    there = {*active(values), *stopped, *(BUS_CUT for name in stopped if _cut(name))}
    rows = [(fault.name, fault.about) for fault in FAULTS]
    rows += [(f"NODE-{name}", about) for name, (_, about) in OF_PROCESSES.items()]
    rows.append((BUS_CUT, "nobody hears anybody: the hub is frozen"))
    rows += [(name, "it is stopped by a signal") for name in sorted(there - dict(rows).keys())]
    if options.json:
        output.document(
            [{"name": name, "about": about, "active": name in there} for name, about in rows]
        )
        return
    marked = (("in" if name in there else "-", name, about) for name, about in rows)
    output.table([("", "FAULT", "WHAT IT DOES"), *marked])


def inject(
    options: Options,
    name: Annotated[str, Arg("A fault, as `fault list` shows it; NODE-killed as safety-killed.")],
) -> None:
    """Put a fault in: a parameter of the simulation, or a signal to a process.

    How bad it is say parameters, as pressure.fault.magnitude; see `param describe dynamics.fault`.

    Example: quadctl fault inject barometer-stuck
    """
    gone = ""
    node, _, what = name.rpartition("-")
    if name == BUS_CUT:
        node, what = "hub", "frozen"
    if node in NODES and what in OF_PROCESSES:
        signalled(options, node, OF_PROCESSES[what][0])
    else:
        fault = _named(name)
        with bus.connect(options) as client:
            gone = _put(client, fault)
    place = f", in the place of {gone}" if gone else ""
    output.either(options, {"injected": name}, f"{name} is in{place}")


def clear(
    options: Options,
    name: Annotated[str, Arg("A fault (default: all that are in).")] = "",
) -> None:
    """Take a fault out, or all of them; a frozen process goes on.

    Example: quadctl fault clear
    """
    if name:
        of_process = name == BUS_CUT or name.removesuffix("-frozen") in NODES
        named = [] if of_process else [_named(name)]
    else:
        there = active(kept(options))
        named = [fault for fault in FAULTS if fault.name in there]
    thawed = [found for found in frozen(options) if name in {"", found, *_cut(found)}]
    for found in thawed:
        signalled(options, found.removesuffix("-frozen"), "CONT")
    if named:
        with bus.connect(options) as client:
            for fault in named:
                _set(client, fault, fault.sound)
    gone = [*thawed, *(fault.name for fault in named)]
    output.either(
        options, {"cleared": gone}, "\n".join(f"{one} is out" for one in gone) or "no fault is in"
    )


def _put(client: Client, fault: Fault) -> str:
    """Put it in; returns the fault that is out by that: of those of one parameter one can be in."""
    ends = time.monotonic() + client.timeout
    there = client.call(get_params(fault.node), GetParamsRequest([fault.parameter])).values
    _set(client, fault, fault.value, max(ends - time.monotonic(), 0.001))
    return next((name for name in active(there) if name != fault.name), "")


def _set(client: Client, fault: Fault, value: object, timeout: float | None = None) -> None:
    request = SetParamsRequest({fault.parameter: value})
    reply = client.call(set_params(fault.node), request, timeout)
    if not reply.success:
        raise Invalid(reply.reason, "nothing was changed")


def _cut(found: str) -> set[str]:
    return {BUS_CUT} if found == "hub-frozen" else set()


def _names() -> list[str]:
    return [fault.name for fault in FAULTS]


def _named(name: str) -> Fault:
    found = next((fault for fault in FAULTS if fault.name == name), None)
    if found is None:
        hint = nearest(name, [*_names(), BUS_CUT]) or "`quadctl fault list` shows them"
        raise UsageError(f"there is no fault {name}", hint)
    return found
