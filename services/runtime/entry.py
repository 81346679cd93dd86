"""Start and end of every process of the system."""

import argparse
import logging
import os
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import zenoh

from quadctl.schemas import keyexpr
from quadctl.schemas.params import Params
from quadctl.schemas.topics import get_params, set_params
from quadctl.services.runtime.bus import session
from quadctl.services.runtime.errors import AlreadyServed, QuadctlError
from quadctl.services.runtime.executor import MultiNodeExecutor
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params import live
from quadctl.services.runtime.params import load as parameters
from quadctl.services.runtime.params.live import LiveParams
from quadctl.services.runtime.params.load import said_of
from quadctl.services.runtime.realm import DEFAULT, Realm, default_name, vehicle_name
from quadctl.services.runtime.security.endpoints import is_secure
from quadctl.services.runtime.shutdown import ShutdownEvent

Run = Callable[[Node, Params], None]


class ReopenSession(Exception):
    """What a service raises to have the session opened anew, and itself run on it."""


_HUB_WAIT = 5.0
_FORGOTTEN = 5.0
"""Seconds after a session's end in which its name may still be taken by itself."""
_REST = 0.3
"""Seconds between closing a session and opening it anew: a hub takes a tenth to understand that its
neighbour is gone, and does not tell one that is back sooner what there is."""


def start(name: str, run: Run, opening: Callable[..., zenoh.Session] | None = None) -> NoReturn:
    """Run a node until SIGINT, SIGTERM, or its supervisor's death; never returns.

    Reads the command line (`--help` tells), opens the session, serves the node's parameters
    and calls `run(node, params)`, once for each of several vehicles, which take turns. `opening` replaces
    the way the session is opened, and opens it again where `run` raises ReopenSession.
    """
    options = _parse(name)
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    for level in (logging.WARNING, logging.ERROR):
        logging.addLevelName(level, logging.getLevelName(level).lower())
    try:
        code = _run(name, run, options, opening or _open_client)
    except QuadctlError as error:
        logging.getLogger(name).error("error: %s. %s", error.message, error.hint)
        code = error.exit_code
    sys.stderr.flush()
    # Zenoh's threads are done with; skipping the interpreter's own farewell saves 5 ms.
    os._exit(code)


def _run(
    name: str, run: Run, options: argparse.Namespace, opening: Callable[..., zenoh.Session]
) -> int:
    realm = Realm(options.realm)
    realm.create()
    fleet = _params(realm, options)
    with ExitStack() as held:
        for vehicle in fleet:
            lock = FileLock(realm.folder / f"{vehicle}.{name}.lock", f"the node {name}")
            held.enter_context(lock)
        address = session.address_of(realm, options.connect)
        _check_role(address.endpoint, name, list(fleet))
        ending, again, patience = ShutdownEvent(), True, 0.0
        while again:
            with opening(address, next(iter(fleet.values())), realm) as opened:
                _check_welcome(opened, options.connect)
                try:
                    executor = _executor_of(name, run, fleet, opened, realm)
                except AlreadyServed:
                    # Hubs further away may still hold our own last session for alive.
                    if time.monotonic() > patience:
                        raise
                else:
                    ending.on_shutdown(executor.stop)
                    try:
                        executor.run()
                        again = False
                    except ReopenSession:
                        again = True
                    patience = time.monotonic() + _FORGOTTEN
            again = again and not ending.wait(_REST)
    return 0


def _check_role(endpoint: str, name: str, vehicles: list[str]) -> None:
    if is_secure(endpoint):
        from quadctl.services.runtime.security import permissions

        permissions.check(
            endpoint, "announce", *(keyexpr.node_key(each, name) for each in vehicles)
        )


def _check_welcome(opened: zenoh.Session, connect: str) -> None:
    if is_secure(connect):
        from quadctl.services.runtime.security import permissions

        permissions.welcome(opened, connect, _HUB_WAIT)


def _executor_of(
    name: str, run: Run, fleet: dict[str, Params], opened: zenoh.Session, realm: Realm
) -> MultiNodeExecutor:
    """The service of every vehicle, about to run."""
    restarted = int(os.environ.get("QUADCTL_RESTARTS", "0")) > 0
    single = len(fleet) == 1
    executor, first = MultiNodeExecutor(single=single), next(iter(fleet.values()))
    for vehicle, params in fleet.items():
        like = None if params is first else first
        own = executor.new_executor()
        node = Node(
            name, vehicle, opened, own, restarted=restarted, reference_params=like, single=single
        )
        _serve_params(node, params, realm)
        executor.add_node(own, partial(run, node, params))
    return executor


def _parse(name: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=f"quadctl's node {name}, one process.")
    parser.add_argument("--realm", default=default_name())
    parser.add_argument("--vehicle", action="append", help="may be given several times")
    parser.add_argument("--connect", default="", help="a hub's endpoint, as tls/host:7447")
    parser.add_argument("--identity", help="who it is on a network: a folder")
    parser.add_argument("--insecure", action="store_true", help="let a plain listener be reached")
    parser.add_argument("--config", type=Path, help="a TOML file, in place of the run's own")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options = parser.parse_args()
    if options.identity:
        os.environ["QUADCTL_IDENTITY"] = options.identity
    if options.insecure:
        os.environ[session.INSECURE] = "1"
    return options


def _params(realm: Realm, options: argparse.Namespace) -> dict[str, Params]:
    said = os.environ.get("QUADCTL_VEHICLES") or os.environ.get("QUADCTL_VEHICLE") or DEFAULT
    vehicles = [vehicle_name(vehicle) for vehicle in options.vehicle or said.split(",")]
    found = {}
    for vehicle in vehicles:
        running = None if options.config else live.read_values(realm, vehicle)
        table, source = parameters.gather(options.config, options.set, running)
        found[vehicle] = parameters.check(said_of(table, vehicle, vehicles), source)
    return found


def _open_client(address: session.Address, _params: Params, _realm: Realm) -> zenoh.Session:
    return session.open_client(address, wait=_HUB_WAIT)


def _serve_params(node: Node, params: Params, realm: Realm) -> None:
    def save(table: Any) -> None:
        live.save_values(realm, node.vehicle, node.name, table)

    served = LiveParams(node.name, params, save, node.params_changed, node.params_in_force)
    node.serve(get_params(node.name), served.get)
    node.serve(set_params(node.name), served.set)
