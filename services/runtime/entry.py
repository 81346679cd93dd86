"""Start and end of every process of the system."""

import argparse
import logging
import os
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import zenoh

from quadctl.schemas import keyexpr
from quadctl.schemas.params import Params
from quadctl.schemas.topics import get_params, set_params
from quadctl.services.runtime.bus import liveliness, session
from quadctl.services.runtime.bus.bundles import Bundles
from quadctl.services.runtime.errors import AlreadyServed, QuadctlError
from quadctl.services.runtime.executor import MultiNodeExecutor
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params import live, load as parameters
from quadctl.services.runtime.params.live import LiveParams
from quadctl.services.runtime.params.load import table_of
from quadctl.services.runtime.realm import DEFAULT, Realm, default_name, vehicle_name
from quadctl.services.runtime.security.endpoints import is_secure
from quadctl.services.runtime.shutdown import ShutdownEvent, end_with_supervisor, interruptible

Run = Callable[[Node, Params], None]


class ReopenSession(Exception):
    """Request of a service, raised in its `run`: open a new session and run again on it."""


_CTRL_C = 130
_HUB_WAIT = 5.0
"""Seconds to wait for a hub."""
_SUPERVISED_WAIT = 3600.0
"""The same under a supervisor, which ends a start that takes too long, and knows how busy the machine is."""
_FORGOTTEN = 5.0
"""Seconds after the end of our session in which hubs may still list its name as taken."""
_REST = 0.3
"""Seconds between closing and reopening a session: a hub needs 0.1 s to notice that its neighbour
is gone, and does not send its declarations to a neighbour that is back sooner."""


def start(
    name: str,
    run: Run,
    opening: Callable[..., zenoh.Session] | None = None,
    *,
    keeps_time: bool = False,
) -> NoReturn:
    """Run a node until SIGINT, SIGTERM, or its supervisor's death; never returns.

    Parses the command line (see `--help`), opens the session, serves the parameters and calls
    `run(node, params)`, once for each of several vehicles, which take turns. `opening` opens the
    session in place of the default, again after each ReopenSession. `keeps_time`: see Node. In a
    run, the name in `[processes]` counts in place of `name`, as in a launch file of ROS.
    """
    end_with_supervisor()
    name = os.environ.get("QUADCTL_NODE") or name
    options = _parse(name)
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    for level in (logging.WARNING, logging.ERROR):
        logging.addLevelName(level, logging.getLevelName(level).lower())
    try:
        interruptible()
        code = _run(name, run, options, opening, keeps_time=keeps_time)
    except QuadctlError as error:
        logging.getLogger(name).error("error: %s. %s", error.message, error.hint)
        code = error.exit_code
    except KeyboardInterrupt:  # before there is a loop to stop
        code = _CTRL_C
    sys.stderr.flush()
    # The session is closed; skipping the interpreter's own shutdown saves 5 ms.
    os._exit(code)


def _run(
    name: str,
    run: Run,
    options: argparse.Namespace,
    opening: Callable[..., zenoh.Session] | None,
    *,
    keeps_time: bool,
) -> int:
    realm = Realm(options.realm)
    realm.create()
    fleet = _params(realm, options)
    with ExitStack() as held:
        for vehicle in fleet:
            path = realm.folder / f"{vehicle}.{name}.lock"
            held.enter_context(FileLock(path, f"the node {name}"))
        address = session.address_of(realm, options.connect, name)
        _check_role(address.endpoint, name, list(fleet))
        opening = opening or _open_client
        ending, again, patience = ShutdownEvent(), True, 0.0
        while again:
            first = next(iter(fleet.values()))
            with session.closing(opening(address, first, realm)) as opened:
                _check_welcome(opened, options.connect)
                try:
                    # With certificates, a question about all vehicles has no answer.
                    few = len(fleet) == 1 or is_secure(address.endpoint)
                    present = liveliness.present(opened, fleet if few else ["*"])
                    guarded = address.user == name
                    executor = _executor_of(
                        name, run, fleet, opened, realm, present, options.connect,
                        keeps_time=keeps_time, guarded=guarded,
                    )  # fmt: skip
                except AlreadyServed:
                    # Distant hubs may still list our own previous session as alive.
                    if time.monotonic() > patience:
                        raise
                else:
                    ending.on_shutdown(executor.stop)
                    with suppress(ReopenSession):
                        executor.run()
                        again = False
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
    name: str,
    run: Run,
    fleet: dict[str, Params],
    opened: zenoh.Session,
    realm: Realm,
    present: liveliness.Present,
    connect: str,
    *,
    keeps_time: bool,
    guarded: bool,
) -> MultiNodeExecutor:
    """Return an executor with the service of every vehicle, ready to run."""
    restarted = int(os.environ.get("QUADCTL_RESTARTS", "0")) > 0
    single = len(fleet) == 1
    executor, first = MultiNodeExecutor(single=single), next(iter(fleet.values()))
    bundles = None if single or guarded or connect else _bundles(opened, executor)
    for vehicle, params in fleet.items():
        like = None if params is first else first
        own = executor.new_executor()
        node = Node(
            name, vehicle, opened, own, present=present, restarted=restarted,
            reference_params=like, single=single, connect=connect,
            lockstep=params.dynamics.in_lockstep, keeps_time=keeps_time, guarded=guarded, bundles=bundles,
        )  # fmt: skip
        _serve_params(node, params, realm)
        executor.add_node(own, partial(run, node, params))
    if not keeps_time:
        executor.watch(logging.getLogger(name).warning)
    return executor


def _bundles(opened: zenoh.Session, executor: MultiNodeExecutor) -> Bundles | None:
    """Return the bundles of a run, None for a process that is not of one with bundles."""
    if not (senders := os.environ.get("QUADCTL_BUNDLED_BY")):
        return None
    lead = os.environ["QUADCTL_VEHICLES"].partition(",")[0]
    return Bundles(opened, lead, senders.split(","), executor.outbox)


def _parse(name: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=f"quadctl's node {name}, one process.")
    parser.add_argument("--realm", default=default_name())
    parser.add_argument("--vehicle", action="append", help="can be given several times")
    parser.add_argument("--connect", default="", help="the hub's endpoint, e.g. tls/host:7447")
    parser.add_argument("--identity", help="folder of the certificate for tls and quic")
    parser.add_argument("--insecure", action="store_true", help="allow open plain endpoints")
    parser.add_argument("--config", type=Path, help="a TOML file instead of the run's own")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options = parser.parse_args()
    if options.identity:
        os.environ["QUADCTL_IDENTITY"] = options.identity
    if options.insecure:
        os.environ[session.INSECURE] = "1"
    return options


def _params(realm: Realm, options: argparse.Namespace) -> dict[str, Params]:
    names = os.environ.get("QUADCTL_VEHICLES") or os.environ.get("QUADCTL_VEHICLE") or DEFAULT
    vehicles = dict.fromkeys(map(vehicle_name, options.vehicle or names.split(",")))
    found = {}
    for vehicle in vehicles:
        running = None if options.config else live.read_values(realm, vehicle)
        table, source = parameters.gather(options.config, options.set, running)
        found[vehicle] = parameters.check(
            table_of(table, vehicle, vehicles), source, in_wind=running is None
        )
    return found


def _open_client(address: session.Address, _params: Params, _realm: Realm) -> zenoh.Session:
    supervised = os.environ.get("QUADCTL_SUPERVISED")
    wait = _SUPERVISED_WAIT if supervised else _HUB_WAIT
    return session.open_client(address, wait=wait, threads=session.TWO_THREADS)


def _serve_params(node: Node, params: Params, realm: Realm) -> None:
    def save(table: Any) -> None:
        live.save_values(realm, node.vehicle, node.name, table)

    served = LiveParams(node.name, params, save, node.params_changed, node.params_in_force)
    node.serve(get_params(node.name), served.get)
    node.serve(set_params(node.name), served.set)
