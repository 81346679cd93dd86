"""Lookup of nodes by the run record and by the bus, and the parameters of a node."""

import contextlib
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from quadctl.cli import context
from quadctl.cli.context import Options
from quadctl.schemas.keyexpr import EndpointInfo, Kind
from quadctl.schemas.services import GetParamsRequest
from quadctl.schemas.topics import get_params
from quadctl.services.runtime import run_files
from quadctl.services.runtime.errors import QuadctlError, TimedOut, Unreachable
from quadctl.services.runtime.params.names import nearest, normal_name
from quadctl.services.runtime.process_table import NODES
from quadctl.services.runtime.procfs import has_ended
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import ProcessRecord, RunState

if TYPE_CHECKING:
    # As in fault.py, for `status`.
    from quadctl.services.runtime.bus.client import Client


class NodesSeen(Struct, frozen=True):
    """Run (None if it is not on this machine), live nodes, and their endpoints."""

    run: RunState | None
    live: list[str]
    offers: list[EndpointInfo]

    @property
    def processes(self) -> list[ProcessRecord]:
        """Return the supervised processes, then any other node that has announced itself."""
        ours = self.run.nodes if self.run else []
        known = {process.name for process in ours}
        strangers = [name for name in self.live if name not in known]
        return [*ours, *(ProcessRecord(name, 0, "ready", 0) for name in strangers)]

    def find(self, name: str) -> ProcessRecord:
        """Return a process by name, also in ROS's form; raise Unreachable with the nearest name."""
        wanted = normal_name(name)
        by_name = {process.name: process for process in self.processes}
        if wanted in by_name:
            return by_name[wanted]
        hint = nearest(wanted, by_name) or f"the nodes are {', '.join(by_name)}"
        raise Unreachable(f"there is no node {name}", hint)

    def answers(self, name: str) -> bool:
        """Return whether a node announces get_params, and so answers calls."""
        return any(offer.type == "GetParams" for offer in self.offered(name, "@srv"))

    def offered(self, name: str, kind: Kind) -> list[EndpointInfo]:
        """Return the endpoints of one kind of a node."""
        return [offer for offer in self.offers if offer.node == name and offer.kind == kind]


def run_of(options: Options) -> RunState | None:
    """Return the realm's run; None if there is none, and with --connect, where it is not ours."""
    with contextlib.suppress(Unreachable):
        return None if options.connect else run_files.read(Realm(options.realm))
    return None


def connected(options: Options, run: RunState | None) -> "Client | QuadctlError":
    """Return a connection, or the error if there is none and `run` has something to show."""
    try:
        return context.connect(options)
    except (Unreachable, TimedOut) as problem:
        if run is None:
            raise
        return problem


def see(client: "Client | None", run: RunState | None, *kinds: Kind, of: str = "") -> NodesSeen:
    """Return the nodes by the run and, with a client, by the bus: of its vehicle or of another."""
    if client is None:
        return NodesSeen(run, [], [])
    return NodesSeen(run, client.nodes(of=of), client.endpoints(*kinds, of=of))


def answering(seen: NodesSeen) -> list[ProcessRecord]:
    """Return the nodes that announce get_params, and the lab's nodes that are away."""
    away = set(NODES) - set(seen.live)
    return [p for p in seen.processes if seen.answers(p.name) or p.name in away]


def params_of(
    client: "Client", process: ProcessRecord, names: list[str], timeout: float
) -> dict[str, Any]:
    """Return a node's parameters; wait up to `timeout` s while it restarts.

    Raises Unreachable for a process that is away, TimedOut for a silent one.
    """
    name = process.name
    if process.state == "down":
        raise Unreachable(f"{name} is down", f"`quadctl node logs {name}` may show why")
    service = get_params(name)
    try:
        return client.call(service, GetParamsRequest(names), timeout).values
    except (TimedOut, Unreachable) as error:
        about_call = service.key(client.vehicle) in error.message
        if isinstance(error, TimedOut):
            if not about_call:
                raise
            # Part of the client's timeout may have passed before this call.
            text = f"{name} did not answer within {client.timeout:g} s"
            raise TimedOut(text, error.hint) from error
        if process.pid and process.state == "ready" and not has_ended(process.pid):
            # The hub drops a frozen process after a second; the supervisor still sees it.
            raise TimedOut(
                f"{name} does not answer, although its process {process.pid} exists",
                "it is frozen or busy: `quadctl status`",
            ) from error
        if not about_call:
            raise
        raise Unreachable(f"{name} did not answer: {_why_away(process)}", error.hint) from error


def _why_away(process: ProcessRecord) -> str:
    if process.pid and has_ended(process.pid):
        return f"its process {process.pid} has ended"
    return "it has left the bus" if process.state == "ready" else f"it is {process.state}"
