"""Systems for programs: `launch` starts one, `connect` reaches one that runs already."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from numbers import Integral
from pathlib import Path
from secrets import token_hex
from typing import Any, Self
from weakref import WeakSet, finalize

from msgspec.structs import replace

from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import (
    AlreadyServed,
    Invalid,
    QuadctlError,
    TimedOut,
    Unreachable,
    UsageError,
)
from quadctl.services.runtime.files import refuse_existing
from quadctl.services.runtime.params import load
from quadctl.services.runtime.params.names import put
from quadctl.services.runtime.realm import DEFAULT, Realm, default_name, listed, vehicle_name
from quadctl.services.runtime.run_files import is_live
from quadctl.services.runtime.supervisor import capacity
from quadctl.services.runtime.supervisor.control import stop_run
from quadctl.services.runtime.supervisor.daemon import end, start_in_background
from quadctl.services.runtime.supervisor.launch import Launch
from quadctl.services.runtime.typed import argument, plain, positive_time
from quadctl.services.runtime.vehicles import only_vehicle
from quadctl.vehicle import Vehicle

TIMEOUT = 3.0
"""Seconds that a reply may take."""


class Run:
    """A system that this program has started: hub, vehicles and their nodes.

    It ends with its `with` block, at `close`, and at the latest with the program, however that
    ends. `realm` is its name for commands: `quadctl status --realm NAME`.
    """

    def __init__(self, launch: Launch, timeout: float, on_progress: Callable[[str], None]) -> None:
        """Start the processes; raise as `start_in_background`, with nothing left running."""
        self.realm = launch.realm
        # Not by a fork: it would inherit the files, the memory and the state of the program.
        self._supervisor = start_in_background(replace(launch, owned=True), on_progress, fork=False)
        self._stop = finalize(self, _stop, Realm(launch.realm), self._supervisor, os.getpid())
        _runs.add(self)
        try:
            client = Client(launch.realm, launch.vehicles[0], timeout=timeout)
            self._clients = [client]
        except BaseException:
            self._stop()
            raise
        self.vehicles = Vehicles(
            (name, Vehicle(client.beside(name, timeout))) for name in launch.vehicles
        )

    @property
    def vehicle(self) -> Vehicle:
        """Return the only vehicle; raise UsageError if there are several."""
        if len(self.vehicles) > 1:
            names = listed(list(self.vehicles))
            raise UsageError(f"there are several vehicles: {names}", 'name one: vehicles["uav0"]')
        return next(iter(self.vehicles.values()))

    def __repr__(self) -> str:
        state = "running" if self._stop.alive and is_live(Realm(self.realm)) else "ended"
        return f"<run {self.realm} of {listed(list(self.vehicles))}, {state}>"

    def logs(self) -> dict[str, list[str]]:
        """Return the lines that each process has logged so far, by its name; raise after `close`."""
        folder = Realm(self.realm).logs
        if not (self._stop.alive and folder.is_dir()):
            raise Unreachable(
                f"the run {self.realm} has ended, and its logs with it", "read them before close()"
            )
        files = sorted(folder.glob("*.log"))
        return {file.stem: file.read_text(errors="replace").splitlines() for file in files}

    def close(self) -> None:
        """Disconnect and end all processes; a second call does nothing."""
        while self._clients:
            self._clients.pop().close()
        self._stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def launch(
    config: str | os.PathLike[str] | None = None,
    *,
    params: Mapping[str, Any] | None = None,
    vehicles: int = 1,
    realm: str | None = None,
    processes: Mapping[str, str] | None = None,
    record: str | os.PathLike[str] | None = None,
    timeout: float = TIMEOUT,
) -> Run:
    """Start a system, and return it when all its nodes answer.

    Args:
        config: parameter file; without one, the defaults count.
        params: parameters by dotted name, e.g. `{"dynamics.speed": 0, "uav1.safety.takeoff": 2}`;
            they override the file.
        vehicles: number of vehicles: one is `uav`, several are `uav0`, `uav1` ..
        realm: name of the run; by default one of its own, so that programs do not meet.
        processes: commands by node, e.g. `{"safety": "python my_safety.py"}`, in place of ours or
            beside them.
        record: file for a recording of the whole run.
        timeout: seconds that a reply may take.

    Raises Invalid for a wrong parameter, UsageError for a wrong name or number, AlreadyServed if the
    realm runs already, and QuadctlError, with the last lines of its log, for a node that fails.
    """
    with _one_traceback():
        timeout = positive_time("timeout", timeout)
        plan = _plan(
            config,
            {} if params is None else params,
            vehicles,
            realm,
            {} if processes is None else processes,
            record,
        )
        try:
            return Run(plan, timeout, lambda _line: None)
        except AlreadyServed as problem:
            # The supervisor's hint is for a command line.
            hint = f"`quadctl down --realm {plan.realm}` ends it; launch(realm=...) of another name"
            raise AlreadyServed(problem.message, f"{hint}, or of none, runs beside it") from None


@contextmanager
def _one_traceback() -> Iterator[None]:
    """Raise our errors without their causes: the message has all that a program's author needs."""
    try:
        yield
    except QuadctlError as problem:
        raise problem from None
    except (UnicodeEncodeError, RecursionError) as error:
        hint = "give texts in Unicode, and tables without an end in themselves"
        raise Invalid(f"a parameter cannot be written: {error}", hint) from None


def _plan(
    config: str | os.PathLike[str] | None,
    params: Mapping[str, Any],
    vehicles: int,
    realm: str | None,
    processes: Mapping[str, str],
    record: str | os.PathLike[str] | None,
) -> Launch:
    """Return the checked settings of a launch with these arguments."""
    argument("params", params, Mapping, "a table of parameters by dotted name")
    argument("vehicles", vehicles, Integral, "a number of vehicles")
    if vehicles < 1:
        raise Invalid(f"vehicles = {vehicles} is not a number of vehicles", "give 1 or more")
    argument("processes", processes, Mapping, "a table of commands by node")
    names = [DEFAULT] if vehicles == 1 else load.names(DEFAULT, vehicles)
    source = None if config is None else _path("config", config)
    table, origin = load.gather(source)
    for name, value in params.items():
        argument("a parameter's name", name, str, "a text")
        put(table, name, plain(value), f"params[{name!r}]")
    if processes:
        table["processes"] = {**table.get("processes", {}), **processes}
    fleet = load.of(table, f"{origin} with params" if params else origin, names)
    folder = source.resolve().parent if source else Path.cwd()
    recording = "" if record is None else str(_new_file("record", record).resolve())
    argument("realm", "" if realm is None else realm, str, "a name")
    name = realm or f"py-{os.getpid()}-{token_hex(2)}"
    plan = Launch(Realm(name).name, fleet, [], str(folder), recording)
    plan.processes()
    capacity.check(plan)
    return plan


def _path(name: str, given: str | os.PathLike[str]) -> Path:
    argument(name, given, (str, os.PathLike), "the path of a file")
    argument(name, os.fspath(given), str, "the path of a file")
    return Path(given)


def _new_file(name: str, given: str | os.PathLike[str]) -> Path:
    path = _path(name, given)
    if not path.absolute().parent.is_dir():
        raise Invalid(f"{name} = {given}: there is no folder {path.parent}", "make it first")
    refuse_existing(path, force=False)
    return path


class UnknownVehicle(UsageError, KeyError):
    """Name that no vehicle of a run has; a KeyError, too."""

    __str__ = Exception.__str__  # that of KeyError shows the quoted text


class Vehicles(dict[str, Vehicle]):
    """Vehicles of a run by name."""

    def __missing__(self, name: str) -> Vehicle:
        raise UnknownVehicle(f"there is no vehicle {name}", f"there are {listed(list(self))}")


class Connection(Vehicle):
    """Vehicle of a system that runs already; `close` or the end of a `with` block disconnects."""

    def close(self) -> None:
        """Disconnect; the system runs on."""
        self.client.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def connect(
    realm: str | None = None,
    vehicle: str | None = None,
    connect: str = "",
    timeout: float = TIMEOUT,
) -> Connection:
    """Connect to a vehicle of a system that runs already.

    Args:
        realm: name of the run; by default that of the environment variable QUADCTL_REALM, else
            `default`.
        vehicle: name of the vehicle; by default that of QUADCTL_VEHICLE, else the only one.
        connect: a hub's Zenoh endpoint, e.g. `tls/host:7447`, in place of the realm's own.
        timeout: seconds that a reply may take.

    Raises Unreachable if nothing runs there, UsageError for a wrong name and if several vehicles
    are there, and TimedOut if the hub does not answer.
    """
    for title, given in (("realm", realm), ("vehicle", vehicle), ("connect", connect)):
        argument(title, "" if given is None else given, str, "a name")
    timeout, connect = positive_time("timeout", timeout), connect or ""
    place = realm or default_name()
    named = vehicle or os.environ.get("QUADCTL_VEHICLE")
    name = vehicle_name(named) if named else only_vehicle(place, connect, timeout)
    return Connection(Client(place, name, connect=connect, timeout=timeout))


_runs: "WeakSet[Run]" = WeakSet()


def _let_go() -> None:
    """Close what a forked process has of its parent's runs: they end with the parent."""
    for run in _runs:
        if (pipe := run._supervisor.stdin) is not None:  # noqa: SLF001 - our own
            pipe.close()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go)


def _stop(realm: Realm, supervisor: Any, maker: int) -> None:
    """End a run, however it has ended or hangs; a fork of its maker leaves it alone."""
    if os.getpid() != maker:
        return
    try:
        stop_run(realm)
    except Unreachable:
        pass  # it has ended otherwise
    except TimedOut:
        supervisor.kill()  # frozen: its processes end with it
    end(supervisor)
    if not is_live(realm):
        with suppress(OSError):
            realm.remove()
