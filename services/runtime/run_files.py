"""Files that a run keeps for commands: run.json and parameter values. Imports nothing heavy."""

from typing import TYPE_CHECKING, Any, Literal

import msgspec
from msgspec import Struct

from quadctl.schemas.typed import from_json
from quadctl.services.runtime.errors import Unreachable
from quadctl.services.runtime.realm import LOCK, RECORD, Realm, default_name, write_atomically

if TYPE_CHECKING:
    from pathlib import Path

UNSERVED = ("supervise", "processes")
"""Tables of the supervisor, which is not a node: nothing on the bus reads or sets them."""


def tables(realm: Realm, vehicle: str) -> dict[str, Any]:
    """Return a vehicle's tables by name; none without such a vehicle or without a run.

    One file has all tables of the launch, and each table that a node changed has its own: a run
    of many vehicles begins with few files.
    """
    found = launch_tables(realm, vehicle)
    for file in changed(realm, vehicle).glob("[!.]*.json") if found else ():
        found[file.stem] = msgspec.json.decode(file.read_bytes())
    return found


def launch_tables(realm: Realm, vehicle: str) -> dict[str, Any]:
    """Return a vehicle's tables of the launch by name; none without such a vehicle or a run."""
    try:
        found: dict[str, Any] = msgspec.json.decode(launched(realm, vehicle).read_bytes())
    except FileNotFoundError:
        return {}
    return found


def launched(realm: Realm, vehicle: str) -> "Path":
    """Return the file of a vehicle's tables at the launch."""
    return realm.params / f"{vehicle}.json"


def changed(realm: Realm, vehicle: str) -> "Path":
    """Return the folder of the tables that a vehicle's nodes changed, one file for each node."""
    return realm.params / vehicle


State = Literal["starting", "ready", "restarting", "down"]


class ProcessRecord(Struct, frozen=True):
    """State of one process; pid 0 while there is none.

    It was started at `started`, Unix s, and at `began` on the machine's monotonic clock, s: the
    time of day may be set meanwhile.
    """

    name: str
    pid: int
    state: State
    restarts: int
    started: float = 0.0
    began: float = 0.0


class RunState(Struct, frozen=True):
    """State of a live run: the supervisor's pid, its vehicles and its processes, with the hub.

    Commands of the parameter file run in `folder`.
    """

    realm: str
    pid: int
    vehicles: list[str]
    nodes: list[ProcessRecord]
    lockstep: bool = False
    folder: str = ""


def write(realm: Realm, record: RunState) -> None:
    """Replace the record in the realm's folder."""
    write_atomically(realm.record, msgspec.json.encode(record))


def is_live(realm: Realm) -> bool:
    """Return whether a supervisor holds the realm."""
    from quadctl.services.runtime.filelock import FileLock

    return FileLock(f"{realm.path}/{LOCK}", "").held()


def read(realm: Realm) -> RunState:
    """Return the record of a live run; raise Unreachable if nothing runs in the realm."""
    try:
        if is_live(realm):
            with open(f"{realm.path}/{RECORD}", "rb") as file:  # noqa: PTH123 - pathlib takes 7 ms
                return from_json(file.read(), RunState)
    except FileNotFoundError:
        pass  # the run ended, or has no record yet
    raise not_running(realm)


def not_running(realm: Realm) -> Unreachable:
    """Return the error for a realm without a run."""
    named = "" if realm.name == default_name() else f" --realm {realm.name}"
    return Unreachable(
        f"nothing is running in the realm {realm.name}", f"`quadctl up -d{named}` starts it"
    )
