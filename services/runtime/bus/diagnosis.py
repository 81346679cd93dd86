"""Explanations of missing answers: frozen, gone, denied or never there."""

from typing import Protocol

import zenoh

from quadctl.schemas.keyexpr import EndpointInfo, Kind
from quadctl.schemas.topics import TOPICS
from quadctl.services.runtime import procfs, run_files
from quadctl.services.runtime.bus import liveliness
from quadctl.services.runtime.errors import NotAllowed, QuadctlError, TimedOut, Unreachable
from quadctl.services.runtime.params.names import nearest
from quadctl.services.runtime.process_table import NODES
from quadctl.services.runtime.realm import Realm, listed
from quadctl.services.runtime.run_files import ProcessRecord, RunState

_LOOK, _SHORT_LOOK = 1.0, 0.1
"""Seconds for the search for a reason, after the timeout; a hub answers in 0.5 ms, a busy machine's in
100, and one whose process is stopped never does."""
NOT_OFFERED_FIX = "add it to your own node, or use ours: see [processes] in quad.toml"
"""Remedy for a node that is there without one of its topics or services."""
_FROZEN = "it is frozen or busy: `quadctl status`"


class DiagnosisClient(Protocol):
    """Part of a client that a diagnosis of its unanswered call needs."""

    realm: Realm
    vehicle: str
    timeout: float

    @property
    def session(self) -> zenoh.Session:
        """Return the open session."""

    def endpoints(self, *kinds: Kind, timeout: float | None = None) -> list[EndpointInfo]:
        """Return the endpoints of the hub's nodes."""

    def silent_processes(
        self, timeout: float | None = None, live: list[str] | None = None
    ) -> list[ProcessRecord]:
        """Return the nodes of this machine's run that are there but lost to the hub."""

    def explained(
        self, problem: Unreachable, node: str = "", key: str = "", live: list[str] | None = None
    ) -> QuadctlError:
        """Return the problem with its reason."""


def _patience(realm: Realm) -> float:
    """Return for how long (s) to ask a realm's hub for a reason."""
    run = _run(realm)
    stopped = run and any(node.name == "hub" and procfs.is_frozen(node.pid) for node in run.nodes)
    return _SHORT_LOOK if stopped else _LOOK


def silent_processes(realm: Realm, vehicle: str, live: list[str]) -> list[ProcessRecord]:
    """Return our nodes that the supervisor calls ready and the hub has lost: frozen for 1 s."""
    run = _run(realm)
    return [
        node
        for node in (run.nodes if run and vehicle in run.vehicles else ())
        if node.name in NODES and node.name not in live and _is_there(node)
    ]


def explain_frozen(problem: Unreachable, node: str, silent: list[ProcessRecord]) -> QuadctlError:
    """Return the problem with the silent processes; TimedOut if `node`, its cause, is one."""
    by_name = {process.name: process for process in silent}
    if node in by_name:
        there = f"although process {by_name[node].pid} of {node} is there"
        return TimedOut(f"{problem.message}, {there}", _FROZEN)
    if node or not silent:
        return problem
    return Unreachable(problem.message, f"{problem.hint}; also silent: {', '.join(by_name)}")


def explain_unreachable(
    client: DiagnosisClient,
    connect: str,
    problem: Unreachable,
    node: str,
    key: str,
    live: list[str] | None,
) -> QuadctlError:
    """Return the problem with all that is known of it, as `Client.explained` describes."""
    try:
        look = _patience(client.realm)
        silent = client.silent_processes(look, live)
        endpoints = client.endpoints(timeout=look) if key else []
        if key and connect:
            from quadctl.services.runtime.security import permissions

            permissions.raise_if_blocked(client.session, connect, key, endpoints)
    except NotAllowed as denied:
        return denied
    except QuadctlError as other:
        return type(other)(f"{problem.message}: {other.message}", other.hint)
    unknown = None if connect else _unknown_vehicle(client, problem)
    lacking = _not_offered_by(node, key, endpoints, problem)
    return unknown or lacking or explain_frozen(problem, node, silent)


def not_offered(node: str, name: str) -> str:
    """Return the sentence on a node that is there without a topic or service of that name."""
    return f"{node} does not offer {name}"


def _not_offered_by(
    node: str, key: str, endpoints: list[EndpointInfo], problem: Unreachable
) -> Unreachable | None:
    """Return the problem if the node of a service is live and offers others, but not this key."""
    is_live = any(offer.node == node for offer in endpoints)
    if not is_live or any(offer.key == key for offer in endpoints):
        return None
    name = key.partition("/@srv/")[2]
    return Unreachable(f"{problem.message}: {not_offered(node, name)}", NOT_OFFERED_FIX)


def explain_silence(client: DiagnosisClient, key: str, *, more: bool) -> QuadctlError:
    """Return why nothing, or no `more`, came on a key: its publisher is quiet, or there is none."""
    came = f"nothing {'more ' if more else ''}came on {key} within {client.timeout:g} s"
    try:
        endpoints = client.endpoints(timeout=_patience(client.realm))
    except QuadctlError as other:
        return type(other)(f"{came}: {other.message}", other.hint)
    offers = [offer for offer in endpoints if offer.kind == "@pub"]
    for offer in offers:
        if liveliness.covers(key, offer.key):
            return TimedOut(
                f"{came}, although {offer.node} publishes it",
                "its process is busy, frozen, or waits for another: `quadctl status`",
            )
    ours = publisher_of(key, client.vehicle)
    if more and ours:
        problem = Unreachable(f"{came}: {ours} is gone", "`quadctl status` shows its state")
    elif more:
        problem = Unreachable(came, "set a longer `--timeout`")
    else:
        like = nearest(key, [offer.key for offer in offers])
        hint = like or "`quadctl topic list` shows all topics"
        problem = Unreachable(f"{came}: it has no publisher", hint)
    return client.explained(problem, ours, live=[offer.node for offer in endpoints])


def _unknown_vehicle(client: DiagnosisClient, problem: Unreachable) -> Unreachable | None:
    """Return the problem if this machine's run, connected to no other, lacks the vehicle."""
    run = _run(client.realm)
    if run is None or client.vehicle in run.vehicles or _meets_others(client.realm, run):
        return None
    hint = nearest(client.vehicle, run.vehicles) or f"it has {listed(run.vehicles)}"
    return Unreachable(f"{problem.message}: this run has no vehicle {client.vehicle}", hint)


def _meets_others(realm: Realm, run: RunState) -> bool:
    hub = run_files.tables(realm, run.vehicles[0]).get("hub", {})
    return bool(hub.get("listen") or hub.get("connect"))


def publisher_of(key: str, vehicle: str) -> str:
    """Return the node that publishes a key's topic; empty for a key that is not ours."""
    return next((topic.node for topic in TOPICS if topic.key(vehicle) == key), "")


def hub_lost(realm: Realm | None, since: float) -> QuadctlError:
    """Return why a connection to a realm's hub, made at `since` (monotonic s), is lost."""
    run = _run(realm) if realm else None
    hub = next((node for node in run.nodes if node.name == "hub"), None) if run else None
    if hub and _is_there(hub):
        if hub.began < since:
            return TimedOut(f"the hub, process {hub.pid}, no longer answers", _FROZEN)
        return Unreachable("the hub was restarted during the command", "run it again")
    return Unreachable(
        "the connection to the hub is lost", "it has ended or is frozen: `quadctl status`"
    )


def _run(realm: Realm) -> RunState | None:
    try:
        return run_files.read(realm)
    except Unreachable:
        return None


def _is_there(node: ProcessRecord) -> bool:
    # The supervisor may not have noticed yet that the node has ended, or be frozen itself.
    return node.state == "ready" and node.pid > 0 and not procfs.has_ended(node.pid)
