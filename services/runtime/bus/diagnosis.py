"""Explanations of missing answers: frozen, gone, denied or never there."""

from typing import Protocol

import zenoh

from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.topics import TOPICS
from quadctl.services.runtime import procfs, run_files
from quadctl.services.runtime.bus import liveliness
from quadctl.services.runtime.errors import NotAllowed, QuadctlError, TimedOut, Unreachable
from quadctl.services.runtime.params.names import nearest
from quadctl.services.runtime.process_table import NODES
from quadctl.services.runtime.realm import Realm, listed
from quadctl.services.runtime.run_files import ProcessRecord, RunState

_LOOK = 0.1
"""Seconds for finding out why, once the timeout is over; a hub answers in half a millisecond."""
_FROZEN = "it is frozen or busy: `quadctl status`"


class Asking(Protocol):
    """A client whose question had no answer, reduced to what the reason takes."""

    session: zenoh.Session
    realm: Realm
    vehicle: str
    timeout: float

    def endpoints(self, timeout: float | None = None) -> list[EndpointInfo]:
        """Return what the hub's nodes offer."""

    def silent_processes(
        self, timeout: float | None = None, live: list[str] | None = None
    ) -> list[ProcessRecord]:
        """Return the nodes of this machine's run that are there although the hub has lost them."""

    def explained(
        self, problem: Unreachable, node: str = "", key: str = "", live: list[str] | None = None
    ) -> QuadctlError:
        """Return the problem with its reason."""


def silent_processes(realm: Realm, vehicle: str, live: list[str]) -> list[ProcessRecord]:
    """Nodes of ours that the supervisor holds for ready and the hub has lost.

    A second after a process froze the hub takes it for gone, but it is still there.
    """
    run = _run(realm)
    return [
        node
        for node in (run.nodes if run and vehicle in run.vehicles else ())
        if node.name in NODES and node.name not in live and _is_there(node)
    ]


def explain_frozen(problem: Unreachable, node: str, silent: list[ProcessRecord]) -> QuadctlError:
    """The problem with what is known of silent processes.

    It is a TimedOut where `node`, whom it is about, is one of them.
    """
    by_name = {process.name: process for process in silent}
    if node in by_name:
        there = f"although the process {by_name[node].pid} of {node} is there"
        return TimedOut(f"{problem.message}, {there}", _FROZEN)
    if node or not silent:
        return problem
    return Unreachable(
        problem.message, f"{problem.hint}; frozen or busy, by the way: {', '.join(by_name)}"
    )


def explain_unreachable(
    client: Asking,
    connect: str,
    problem: Unreachable,
    node: str,
    key: str,
    live: list[str] | None,
) -> QuadctlError:
    """The problem with all that is known of it; a client's side of `explained`.

    NotAllowed where the hub at `connect` keeps us from a `key` that is served.
    """
    try:
        silent = client.silent_processes(_LOOK, live)
        if key and connect:
            from quadctl.services.runtime.security import permissions

            permissions.tell_apart(client.session, connect, key, client.endpoints(_LOOK))
    except NotAllowed as denied:
        return denied
    except QuadctlError as other:
        return type(other)(f"{problem.message}: {other.message}", other.hint)
    stranger = None if connect else _stranger(client, problem)
    return stranger or explain_frozen(problem, node, silent)


def explain_silence(client: Asking, key: str, *, more: bool) -> QuadctlError:
    """Why nothing came on a key or key expression: its publisher is quiet, or there is none.

    `more` says that something had come before.
    """
    came = f"nothing {'more ' if more else ''}came on {key} within {client.timeout:g} s"
    try:
        told = client.endpoints(_LOOK)
    except QuadctlError as other:
        return type(other)(f"{came}: {other.message}", other.hint)
    offers = [offer for offer in told if offer.kind == "@pub"]
    for offer in offers:
        if liveliness.covers(key, offer.key):
            return TimedOut(
                f"{came}, although {offer.node} publishes it",
                "its process is busy, frozen, or waits for another: `quadctl status`",
            )
    ours = publisher_of(key, client.vehicle)
    if more and ours:
        problem = Unreachable(f"{came}: {ours} is gone", "`quadctl status` shows what became of it")
    elif more:
        problem = Unreachable(came, "`--timeout` lets it wait for longer")
    else:
        like = nearest(key, [offer.key for offer in offers])
        hint = like or "`quadctl topic list` shows what there is"
        problem = Unreachable(f"{came}: nobody publishes it", hint)
    return client.explained(problem, ours, live=[offer.node for offer in told])


def _stranger(client: Asking, problem: Unreachable) -> Unreachable | None:
    """That the run on this machine, where it is all that there is, has no such vehicle."""
    run = _run(client.realm)
    if run is None or client.vehicle in run.vehicles or _meets_others(client.realm, run):
        return None
    hint = nearest(client.vehicle, run.vehicles) or f"it has {listed(run.vehicles)}"
    return Unreachable(f"{problem.message}: this run has no vehicle {client.vehicle}", hint)


def _meets_others(realm: Realm, run: RunState) -> bool:
    hub = run_files.tables(realm, run.vehicles[0]).get("hub", {})
    return bool(hub.get("listen") or hub.get("connect"))


def publisher_of(key: str, vehicle: str) -> str:
    """Which node a key's topic comes from; empty for a key that is none of ours."""
    return next((topic.node for topic in TOPICS if topic.key(vehicle) == key), "")


def hub_lost(realm: Realm | None, since: float) -> QuadctlError:
    """Why a connection to a realm's hub is no more, which was made at that Unix time (s)."""
    run = _run(realm) if realm else None
    hub = next((node for node in run.nodes if node.name == "hub"), None) if run else None
    if hub and _is_there(hub):
        if hub.started < since:
            return TimedOut(f"the hub, process {hub.pid}, does not answer any more", _FROZEN)
        return Unreachable("the hub was restarted meanwhile", "ask again")
    return Unreachable(
        "the connection to the hub is lost", "it has ended or is frozen: `quadctl status`"
    )


def _run(realm: Realm) -> RunState | None:
    try:
        return run_files.read(realm)
    except Unreachable:
        return None


def _is_there(node: ProcessRecord) -> bool:
    # The supervisor may not have seen yet that it has just ended, or be frozen itself.
    return node.state == "ready" and node.pid > 0 and not procfs.has_ended(node.pid)
