"""`node list` and `node info`."""

import time
from typing import Annotated, Any

import msgspec

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg
from quadctl.cli.node.lookup import NodesSeen, answering, connected, params_of, run_of, see
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.procfs import ProcessStats, pss_of, stats_of
from quadctl.services.runtime.run_files import ProcessRecord


def list_(options: Options) -> None:
    """List the nodes of all vehicles: those that `up` supervises, and any other that is announced.

    Example: quadctl node list
    """
    run = run_of(options)
    vehicles = context.listed_vehicles(options)
    client = connected(context.with_any_vehicle(options), run)
    if isinstance(client, QuadctlError):
        output.note(f"the bus cannot be seen: {client.message}")
        by_vehicle = {vehicle: see(None, run) for vehicle in vehicles}
    else:
        with client:
            by_vehicle = {vehicle: see(client, run, of=vehicle) for vehicle in vehicles}
        context.check_vehicle(options, [name for seen in by_vehicle.values() for name in seen.live])
    nodes: list[dict[str, Any]] = [
        {"vehicle": vehicle}
        | msgspec.to_builtins(process)
        | {
            "topics": [offer.key for offer in seen.offered(process.name, "@pub")],
            "services": [offer.key for offer in seen.offered(process.name, "@srv")],
        }
        for vehicle, seen in by_vehicle.items()
        for process in seen.processes
    ]
    if options.json:
        output.document(nodes)
        return
    rows = [
        (node["vehicle"], node["name"], node["state"], node["pid"] or "-", node["restarts"],
         len(node["topics"]), len(node["services"]))
        for node in nodes
    ]  # fmt: skip
    title = ("VEHICLE", "NAME", "STATE", "PID", "RESTARTS", "TOPICS", "SERVICES")
    output.listing(vehicles, [title, *rows])


def info(options: Options, name: Annotated[str, Arg("A node.", complete="node")]) -> None:
    """Show a node: its process, topics, subscriptions, services, parameters, memory and CPU time.

    Example: quadctl node info safety
    """
    deadline = time.monotonic() + options.timeout
    options, name = context.about_node(options, name)
    run = run_of(options)
    client = connected(options, run)
    if isinstance(client, QuadctlError):
        # Show the rest; the exit code reports the problem.
        problem: QuadctlError | None = client
        params: list[str] = []
        seen = see(None, run)
        process = seen.find(name)
    else:
        with client:
            seen = see(client, run, "@pub", "@srv", "@sub")
            context.check_vehicle(options, seen.live)
            process = seen.find(name)
            params, problem = _params(client, seen, process, deadline)
    stats = stats_of(process.pid) if process.pid else ProcessStats()
    pss = pss_of(process.pid) if process.pid else None
    document = _document(process, seen, params, stats, pss)
    if options.json:
        output.document(document)
    else:
        _print(document)
    if problem is not None:
        raise problem


def _params(
    client: Client, seen: NodesSeen, process: ProcessRecord, deadline: float
) -> tuple[list[str], QuadctlError | None]:
    """Return the names of a node's parameters, and the error if it does not answer."""
    if process.state != "ready" or process not in answering(seen):
        return [], None
    try:
        left = max(deadline - time.monotonic(), 0.001)
        return [*params_of(client, process, [], left)], None
    except QuadctlError as problem:
        return [], problem


def _document(
    process: ProcessRecord, seen: NodesSeen, params: list[str], stats: ProcessStats, pss: int | None
) -> dict[str, Any]:
    return {
        "name": process.name,
        "state": process.state,
        "pid": process.pid,
        "restarts": process.restarts,
        "started": process.started,
        "began": process.began,
        "supervised": seen.run is not None and process in seen.run.nodes,
        "uptime": stats.uptime,
        "pss": pss,
        "rss": stats.rss,
        "cpu": stats.cpu,
        "topics": [
            {"key": offer.key, "type": offer.type, "declared_hz": offer.hz}
            for offer in seen.offered(process.name, "@pub")
        ],
        "subscriptions": [
            {"key": offer.key, "type": offer.type} for offer in seen.offered(process.name, "@sub")
        ],
        "services": [
            {"name": offer.name, "key": offer.key, "type": offer.type}
            for offer in seen.offered(process.name, "@srv")
        ],
        "params": params,
    }


def _print(node: dict[str, Any]) -> None:
    rows = [
        ("Node:", node["name"]),
        ("State:", node["state"]),
        ("Pid:", node["pid"] or "-"),
        ("Restarts:", node["restarts"]),
        ("Since:", _since(node["uptime"])),
        ("Memory:", f"{_megabytes(node['pss'])} PSS, {_megabytes(node['rss'])} RSS"),
        ("CPU time:", "-" if node["cpu"] is None else f"{node['cpu']:.2f} s"),
    ]
    output.table(rows)
    topics = [
        f"{topic['key']} [{topic['type']}] {f'{hz:g} Hz' if hz else 'on change'}"
        for topic in node["topics"]
        for hz in [topic["declared_hz"]]
    ]
    used, served = (
        [f"{each['key']} [{each['type']}]" for each in node[kind]]
        for kind in ("subscriptions", "services")
    )
    for title, items in (("Topics", topics), ("Subscriptions", used), ("Services", served),
                         ("Parameters", node["params"])):  # fmt: skip
        output.line(f"{title}:{'' if items else ' none'}")
        for item in items:
            output.line(f" * {item}")


def _since(uptime: float | None) -> str:
    if uptime is None:
        return "-"
    began = time.localtime(time.time() - uptime)
    return f"{time.strftime('%Y-%m-%d %H:%M:%S', began)}, {uptime:.0f} s ago"


def _megabytes(size: int | None) -> str:
    return "-" if size is None else f"{size / 1e6:.1f} MB"
