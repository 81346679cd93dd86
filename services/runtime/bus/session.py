"""Client sessions: Zenoh's configuration, and the connection to a realm's hub.

Nothing listens on a network port by default, and multicast is off. The settings were measured.
"""

import contextlib
import gc
import os
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any
from weakref import WeakSet

import msgspec
import zenoh
from msgspec import Struct

from quadctl.schemas.typed import from_json
from quadctl.services.runtime.errors import NotAllowed, TimedOut, Unreachable
from quadctl.services.runtime.realm import ADDRESS, Realm, write_atomically
from quadctl.services.runtime.run_files import is_live, not_running
from quadctl.services.runtime.security import endpoints
from quadctl.services.runtime.security.endpoints import check, how_to_open, is_secure

TWO_THREADS = (
    "(rx: (worker_threads: 1), acc: (handover: app), tx: (handover: app), net: (handover: app),"
    " app: (worker_threads: 1))"
)
"""One reading thread and one writing thread: fewer wakes save processor time and call time. A
single thread would stop the hub for good at a query of a megabyte, as reading waits for room to
write, and a node at some 1000 queries at once, as it answers some on the thread that reads. So the
writing thread also watches all sockets (`acc`): it learns when there is room."""
CLIENT_THREADS = (
    "(rx: (handover: app), acc: (handover: app), tx: (handover: app), net: (handover: app),"
    " app: (worker_threads: 1))"
)
"""One thread for all: a client neither forwards nor answers what it reads."""
_STACK = 16 * 2**20
"""Bytes for the stack of a thread of Zenoh; only the used ones take memory. A reader of nested data
calls itself for each level, and Python 3.12 and 3.13 end that at 10 000 calls: more than fit in the
usual 2 MB, so that one message would end the process."""
_DECLARATIONS = 16
"""Batches of 64 KB of declarations that may wait to be written; made when needed. The thread that
declares holds Zenoh's tables until there is room, and a single thread, which waits for the tables to
store what it has read, then writes nothing: a process of 200 vehicles declares some 200 KB at once,
and with Zenoh's own 2 batches, on a busy machine, one start in ten stood still so."""
INSECURE = "QUADCTL_INSECURE"
"""Environment variable that allows plain endpoints beyond this machine."""

_RETRY_MS = 10
"""Milliseconds between a client's attempts while a hub starts; they cost nothing."""
JOIN_MS = 100
"""The same over a network and between hubs, where each attempt costs the peer a handshake."""
LEASE_AFAR_MS = 4000
"""Lease between machines: a network of 30 laptops, or one laptop, sometimes stalls for 1 s, and a
peer that times out must redo the handshake and declare everything again."""
LEASE_PATIENT_MS = 20_000
"""Lease in a run that waits for each of its processes, on a machine of any load."""


class Address(Struct, frozen=True):
    """Endpoint of a realm's hub; user and password only if it asks for them.

    It does so on a port, and if a node has an address of its own: that node's name is the user, and
    its rights are those of the name. `lease_ms`: milliseconds of silence after which a hub counts as
    gone, and half of a client's.
    """

    endpoint: str
    user: str = ""
    password: str = ""
    lease_ms: int = 1000


def free_port() -> int:
    """Return a loopback port that nothing listens on."""
    import socket  # takes 3 ms, and commands need no port

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def address_of(realm: Realm, connect: str = "", node: str = "") -> Address:
    """Return the endpoint of `--connect` if given, else the address in the realm's folder.

    That is the node's own, if it has one.
    """
    if connect:
        return Address(connect)
    for name in (f"{node}.{ADDRESS}", ADDRESS):
        with (
            contextlib.suppress(FileNotFoundError),
            open(f"{realm.path}/{name}", "rb") as file,  # noqa: PTH123 - pathlib takes 5 ms
        ):
            return from_json(file.read(), Address)
    return Address(realm.endpoint)


def addresses_of_nodes(realm: Realm) -> list[Address]:
    """Return the addresses of the nodes that have one of their own."""
    files = realm.folder.glob(f"*.{ADDRESS}")
    return [from_json(file.read_bytes(), Address) for file in files]


def write_addresses(realm: Realm, address: Address, nodes: Sequence[Address]) -> None:
    """Write the address of a realm's hub, and those of nodes with one of their own."""
    for node in nodes:
        write_atomically(realm.folder / f"{node.user}.{ADDRESS}", msgspec.json.encode(node))
    write_atomically(realm.address, msgspec.json.encode(address))


def open_client(
    address: Address, *, wait: float = 0.0, timeout: float = 5.0, threads: str = CLIENT_THREADS
) -> zenoh.Session:
    """Open a client of the hub, waiting up to `wait` seconds for it to come up.

    A client that reads very much needs two `threads`: one has no time left for keep-alives. With a
    wait the session also reconnects by itself while it lives, and restores its declarations. Raises
    Unreachable without a hub, and without a wait TimedOut if it is not open in `timeout` seconds.
    """
    config, began = common_config(address), time.monotonic()
    secure = endpoints.is_secure(address.endpoint)
    link = config["transport"]["link"]
    # A hub that waits for another client, for as long as its own lease, reads nothing meanwhile.
    link["tx"]["lease"] = LEASE_AFAR_MS if secure else 2 * address.lease_ms
    if secure:
        from quadctl.services.runtime.security import identity

        link["tls"] = identity.needed(address.endpoint).tls()
    open_timeout = max(int(timeout * 1000), 1)
    config["transport"]["unicast"] = {"open_timeout": open_timeout}
    config["mode"] = "client"
    config["connect"] = {"endpoints": [address.endpoint]}
    link["tx"]["queue"] = {"size": {"control": _DECLARATIONS}}
    if wait:
        step = JOIN_MS if secure else _RETRY_MS
        config["connect"] |= {"timeout_ms": int(wait * 1000), "retry": retry(step)}
        # Samples carry a time, needed by latched topics and `topic delay`.
        config["timestamping"] = {"enabled": True}
    try:
        return open_with(config, threads)
    except zenoh.ZError as error:
        # Without a hub the attempt fails at once, long before the timeout.
        if not wait and time.monotonic() - began >= open_timeout / 1000:
            raise TimedOut(
                f"{address.endpoint} did not answer within {timeout:g} s",
                "is it a hub, is its process frozen, does the network let you through?",
            ) from error
        if secure:
            from quadctl.services.runtime.security.permissions import why

            raise why(address.endpoint, timeout) from error
        raise Unreachable(
            f"nothing answers at {address.endpoint}", "start the system with `quadctl up`"
        ) from error


def is_forked() -> bool:
    """Return whether this process was forked from one with a session: it has none of Zenoh's threads."""
    return bool(_opened_by - {os.getpid()})


def refuse_fork() -> None:
    """Raise Unreachable in such a process."""
    if is_forked():
        raise forked()


def forked() -> Unreachable:
    """Return the error for the use of Zenoh there."""
    return Unreachable(
        "this process was forked from one with a connection, and cannot use it or make one",
        'start it afresh, e.g. with multiprocessing.get_context("spawn")',
    )


_live: WeakSet[Any] = WeakSet()


def abandon_in_fork(connection: Any) -> None:
    """Mark a connection `is_closed` and `is_forked` in each process that is forked from this one."""
    _live.add(connection)


_keep: "Callable[[object], object]" = id
"""Function that keeps an object for ever; ready before a fork, as the child may not wait for an import."""


def _before_fork() -> None:
    if _live:
        from ctypes import py_object, pythonapi

        global _keep  # noqa: PLW0603 - the hooks of a fork take no arguments
        _keep = pythonapi.Py_IncRef
        _keep.argtypes = [py_object]


def _in_fork() -> None:
    """Give all connections up in a forked process, and keep Zenoh's objects.

    To collect one would wait, for ever, for a thread that only the parent has.
    """
    if not _live:
        return
    for connection in _live:
        connection.is_closed = connection.is_forked = True
    kinds = {kind for kind in vars(zenoh).values() if isinstance(kind, type)}
    for holder in gc.get_objects():
        for held in gc.get_referents(holder):
            if type(held) in kinds:
                _keep(held)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_child=_in_fork)


def retry(period_ms: int) -> dict[str, int]:
    """Return the settings of a session that retries to connect every `period_ms`."""
    return {"period_init_ms": period_ms, "period_max_ms": period_ms, "period_increase_factor": 1}


def common_config(address: Address) -> dict[str, Any]:
    """Return the common part of a router's and a client's configuration."""
    transport: dict[str, Any] = {
        "shared_memory": {"enabled": False},
        "link": {"tx": {"lease": address.lease_ms}},
    }
    if address.user:
        transport["auth"] = {"usrpwd": {"user": address.user, "password": address.password}}
    return {"scouting": {"multicast": {"enabled": False}}, "transport": transport}


_CALLS = 5.0
"""Seconds for the calls of other threads before a session is closed."""


@contextlib.contextmanager
def closing(session: zenoh.Session) -> Iterator[zenoh.Session]:
    """Close a session with the block."""
    try:
        yield session
    finally:
        close(session)


@contextlib.contextmanager
def unless_closed(session: zenoh.Session) -> Iterator[None]:
    """Raise Unreachable in place of Zenoh's error about a session that another thread has closed."""
    try:
        yield
    except zenoh.ZError as error:
        if session.is_closed():
            raise Unreachable("the connection is closed", "its process is ending") from error
        raise


def close(session: zenoh.Session) -> None:
    """Close a session; the binding refuses to while another thread is in a call of it."""
    until = time.monotonic() + _CALLS
    while True:
        try:
            session.close()
        except RuntimeError:
            if time.monotonic() > until:
                raise
            time.sleep(0.001)
        else:
            return


_opened_by: set[int] = set()
"""Process that has opened a session."""


def open_with(config: dict[str, Any], threads: str) -> zenoh.Session:
    """Open a session with these Zenoh threads; raise zenoh.ZError, Unreachable in a forked process."""
    refuse_fork()
    _opened_by.add(os.getpid())
    # Zenoh reads both when the process opens its first session. They must not stay in the
    # environment: child processes have their own.
    wanted = {"ZENOH_RUNTIME": threads, "RUST_MIN_STACK": str(_STACK)}
    ours = {name: value for name, value in wanted.items() if name not in os.environ}
    os.environ.update(ours)
    try:
        return zenoh.open(zenoh.Config.from_json5(msgspec.json.encode(config).decode()))
    finally:
        for name in ours:
            del os.environ[name]


_POLL = 0.05


def connect_to_hub(realm: Realm, connect: str, timeout: float) -> zenoh.Session:
    """Connect or fail at once; wait only for a hub or gate that is just being restarted.

    `connect` is an endpoint in place of the realm's own, or empty. Raises Unreachable when no hub
    is there, TimedOut when it does not answer in time (s), UsageError for an invalid endpoint.
    """
    refuse_fork()
    if connect:
        check(connect)
    if is_secure(connect):
        return _through_gate(Address(connect), timeout)
    address, began = address_of(realm, connect), time.monotonic()
    silent = f"the realm {realm.name} is up, but its hub did not answer within {timeout:g} s"
    try:
        return open_client(address, timeout=timeout)
    except TimedOut as problem:
        if connect:
            raise
        raise TimedOut(
            silent,
            "its process is frozen or busy: it is restarted by itself, or with"
            " `quadctl node restart hub`",
        ) from problem
    except Unreachable as problem:
        if connect:
            raise Unreachable(problem.message, how_to_open(connect)) from problem
        if not is_live(realm):
            raise not_running(realm) from None
        left = timeout - (time.monotonic() - began)
        if left > 0:
            with contextlib.suppress(Unreachable):
                return open_client(address, wait=left, timeout=left)
        raise Unreachable(
            silent,
            "it is restarted by itself; if that does not help: `quadctl down`, `quadctl up`",
        ) from None


def _through_gate(address: Address, timeout: float) -> zenoh.Session:
    # A gate reopens for each new list of names, which may be the first with ours: a client that was
    # refused, or came before, must try again.
    from quadctl.services.runtime.security import permissions

    began = seen = time.monotonic()
    while True:
        try:
            session = open_client(address, timeout=timeout)
        except NotAllowed:
            raise
        except Unreachable:
            if time.monotonic() > seen + min(timeout, permissions.IN_FORCE):
                raise
        else:
            while (
                not (let_in := permissions.is_let_in(session, timeout))
                and session.info.routers_zid()
            ):
                if time.monotonic() > began + min(timeout, permissions.IN_FORCE):
                    raise permissions.kept_out(address.endpoint)
                time.sleep(_POLL)
            if let_in:
                return session
            seen = time.monotonic()
        time.sleep(_POLL)
