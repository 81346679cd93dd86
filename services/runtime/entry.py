"""How every process of the system starts and ends."""

import argparse
import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import zenoh

from schemas.params import Params
from schemas.topics import get_params, set_params
from services.runtime import params as parameters
from services.runtime import session, snapshot
from services.runtime.ending import stop_on_signals
from services.runtime.errors import QuadctlError
from services.runtime.live import LiveParams
from services.runtime.lock import FileLock
from services.runtime.node import Node
from services.runtime.realm import Realm, default_name, vehicle_name

Run = Callable[[Node, Params], None]

_HUB_WAIT = 5.0


def start(name: str, run: Run, opening: Callable[..., zenoh.Session] | None = None) -> NoReturn:
    """Run a node until SIGINT, SIGTERM, or its supervisor's death; never returns.

    Reads the command line (`--help` tells), opens the session, serves the node's parameters
    and calls `run(node, params)`. `opening` replaces the way the session is opened.
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
    params = _params(realm, options)
    with FileLock(realm.folder / f"{options.vehicle}.{name}.lock", f"the node {name}"):
        address = session.address_of(realm, options.connect)
        with opening(address, params, realm) as opened:
            restarted = int(os.environ.get("QUADCTL_RESTARTS", "0")) > 0
            node = Node(name, vehicle_name(options.vehicle), opened, restarted=restarted)
            stop_on_signals(node.stop)
            _serve_params(node, params, realm)
            run(node, params)
    return 0


def _parse(name: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=f"quadctl's node {name}, one process.")
    parser.add_argument("--realm", default=default_name())
    parser.add_argument("--vehicle", default=os.environ.get("QUADCTL_VEHICLE", "uav"))
    parser.add_argument("--connect", default="", help="a hub's endpoint, as tls/host:7447")
    parser.add_argument("--config", type=Path, help="a TOML file, in place of the run's own")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    return parser.parse_args()


def _params(realm: Realm, options: argparse.Namespace) -> Params:
    running = None if options.config else snapshot.read(realm)
    return parameters.load(options.config, options.set, running)


def _open_client(address: session.Address, _params: Params, _realm: Realm) -> zenoh.Session:
    return session.open_client(address, wait=_HUB_WAIT)


def _serve_params(node: Node, params: Params, realm: Realm) -> None:
    def save(table: Any) -> None:
        if realm.params.is_dir():
            snapshot.save(realm.params, node.name, table)

    live = LiveParams(node.name, params, save, node.params_changed)
    node.serve(get_params(node.name), live.get)
    node.serve(set_params(node.name), live.set)
