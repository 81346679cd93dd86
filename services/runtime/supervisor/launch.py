"""Launch of a run: settings, lock on the realm, files."""

import contextlib
import os
import secrets
import shutil
import socket
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path
from typing import Self

from msgspec import Struct
from msgspec.structs import replace

from quadctl.schemas.params import Params
from quadctl.services.runtime import run_files
from quadctl.services.runtime.bus.session import (
    LEASE_PATIENT_MS,
    Address,
    free_port,
    write_addresses,
)
from quadctl.services.runtime.errors import AlreadyServed, Invalid, QuadctlError
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.params import live
from quadctl.services.runtime.process_table import NODES, Process, table
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import ProcessRecord, RunState
from quadctl.services.runtime.security import endpoints
from quadctl.services.runtime.supervisor import logs

_ATTEMPTS = 100
_PATIENCE = 2 * LEASE_PATIENT_MS / 1000


class Launch(Struct, frozen=True):
    """Settings of a supervisor, with each vehicle's parameters.

    `[processes]` commands run in `folder`. The run is recorded to `record`, if it is not empty.
    `bridges` names bridges to other networks, see BRIDGES.
    `insecure` allows plain endpoints beyond this machine. An `owned` run ends with its starter. In
    a `patient` run, which flies in lock-step, a process may be silent for long: on a busy machine
    a flight then takes longer, and is the same. In a `guarded` run a `[processes]` command has the
    rights of the node that it replaces, and no more.
    """

    realm: str
    fleet: dict[str, Params]
    without: list[str]
    folder: str
    record: str = ""
    insecure: bool = False
    owned: bool = False
    patient: bool = False
    guarded: bool = False
    bridges: tuple[str, ...] = ()

    @property
    def vehicles(self) -> list[str]:
        """Return the names of the vehicles."""
        return list(self.fleet)

    @property
    def params(self) -> Params:
        """Return the first vehicle's parameters; all vehicles share those of hub and run."""
        return self.fleet[self.vehicles[0]]

    @property
    def answer_timeout(self) -> float:
        """Return the seconds after which a silent process is restarted."""
        timeout = self.params.supervise.answer_timeout
        return max(timeout, _PATIENCE) if self.patient else timeout

    @property
    def bundling(self) -> list[str]:
        """Return our nodes that send bundles: of several vehicles in real time."""
        if len(self.fleet) == 1 or self.params.dynamics.in_lockstep:
            return []
        others = {*self.params.processes, *self.without}
        return [name for name in NODES if name not in others]

    def processes(self) -> tuple[Process, ...]:
        """Return the processes to run; raises Invalid for a missing command or hub.

        Raises UsageError for endpoints that are open to all, or need an identity that is not given.
        """
        hub = self.params.hub
        reached = [*hub.listen, *hub.connect]
        gate = endpoints.secure(reached)
        if gate:
            from quadctl.services.runtime.security.access_control import identity_for

            identity_for(gate)
        if not self.insecure:
            endpoints.refuse_open(reached)
        rows = table(
            self.params.processes,
            self.without,
            gate=bool(gate),
            record=bool(self.record),
            bridges=self.bridges,
            vehicles=len(self.fleet),
        )
        self._check_hub(rows)
        path = self.environment("", 0)["PATH"]
        for process in rows:
            program = process.command[0]
            # Search as the child will: a path from the file's folder, a plain name on PATH.
            there = Path(self.folder) / program if Path(program).name != program else program
            if process.stranger and shutil.which(there, path=path) is None:
                raise Invalid(
                    f"processes.{process.name}: {program} was not found, or is not executable",
                    "give a command that this shell can run",
                )
        return rows

    def _check_hub(self, rows: tuple[Process, ...]) -> None:
        needs = [process.name for process in rows if process.must_announce]
        if needs and "hub" not in needs and not _answers(Realm(self.realm).socket):
            raise Invalid(
                f"--without hub: {', '.join(needs)} need a hub; the realm {self.realm} has none",
                f"start one first: python -P -m quadctl.services.hub --realm {self.realm}",
            )

    def environment(self, name: str, restarts: int) -> dict[str, str]:
        """Return the variables that the process of that name gets in addition to ours."""
        identity = os.environ.get("QUADCTL_IDENTITY")
        # `python` in a command means the interpreter that has quadctl.
        path = os.pathsep.join((sysconfig.get_path("scripts"), os.environ.get("PATH", "")))
        return {
            "QUADCTL_REALM": self.realm,
            "QUADCTL_VEHICLES": ",".join(self.vehicles),
            "QUADCTL_VEHICLE": self.vehicles[0] if len(self.vehicles) == 1 else "",
            "QUADCTL_NODE": name,
            "QUADCTL_RESTARTS": str(restarts),
            "QUADCTL_SUPERVISED": "1",
            "QUADCTL_BUNDLED_BY": ",".join(self.bundling),
            "QUADCTL_RECORD": self.record,
            "QUADCTL_RECORD_LITTLE": "1" if self.guarded else "",
            "QUADCTL_INSECURE": "1" if self.insecure else "",
            # Children may run in another folder.
            "QUADCTL_IDENTITY": str(Path(identity).absolute()) if identity else "",
            "PYTHONUNBUFFERED": "1",
            "PATH": path,
        }


def hold(realm: Realm) -> FileLock:
    """Lock the realm for a supervisor; raises AlreadyServed with the pid of its holder."""
    hint = f"`quadctl down --realm {realm.name}` ends it; another --realm runs beside it"
    lock = FileLock(realm.lock, f"the realm {realm.name}", hint)
    for _ in range(_ATTEMPTS):
        # A run that ends at this moment may remove the folder.
        with contextlib.suppress(FileNotFoundError):
            realm.create()
            return lock.acquire()
    raise QuadctlError(f"{realm.folder} cannot be made", "set XDG_RUNTIME_DIR to another folder")


def _answers(path: Path) -> bool:
    """Return whether a process listens on a Unix socket."""
    if sys.platform == "win32":
        return False
    with socket.socket(socket.AF_UNIX) as probe:
        return probe.connect_ex(str(path)) == 0


def choose_address(realm: Realm, transport: str) -> Address:
    """Choose the address of this run's hub."""
    unix = hasattr(socket, "AF_UNIX") and sys.platform != "win32"
    if transport == "unix" or (transport == "auto" and unix):
        return Address(realm.endpoint)
    return _with_password(Address(f"tcp/127.0.0.1:{free_port()}"), secrets.token_hex(8))


def _with_password(address: Address, user: str) -> Address:
    return replace(address, user=user, password=secrets.token_hex(16))


class RunDirectory:
    """Folder of a run for a `with` block, which raises AlreadyServed if the realm is live.

    Enter it with signals delayed: what an interrupted start leaves looks like another run's.
    """

    def __init__(self, launch: Launch) -> None:
        self.realm, self._launch = Realm(launch.realm), launch
        self._lock: FileLock
        self._guarded: list[Address] = []
        self._is_held = self._lost = self.keeps_logs = False

    def write(self, rows: list[ProcessRecord]) -> None:
        """Write the record; raises OSError."""
        launch = self._launch
        lockstep = launch.params.dynamics.in_lockstep
        run = RunState(self.realm.name, os.getpid(), launch.vehicles, rows, lockstep, launch.folder)
        run_files.write(self.realm, run)

    def repair(self, log: Callable[[str], None]) -> bool:
        """Create the folder again if it was removed, and return whether that was done.

        Raises AlreadyServed if another run has taken the realm since.
        """
        if self._lock.is_held_by_us():
            return False
        if not self._lost:
            self._lost = True
            log(f"{self.realm.folder} was removed under the run")
        try:
            self._lock.release()
            self._lock = hold(self.realm)
            self._write_files()
        except AlreadyServed:
            raise
        except (OSError, QuadctlError):
            # The loss is logged already; the next call tries again.
            return False
        self._lost = False
        log(f"{self.realm.folder} was created again, with the parameters of the launch")
        return True

    def remove(self) -> None:
        """Remove the folder, unless it belongs to another run by now."""
        if not self._is_held:
            return
        if self._lock.is_held_by_us():
            self.realm.remove(but_logs=self.keeps_logs)
        self._lock.release()

    def _take(self) -> None:
        self._lock, self._is_held = hold(self.realm), True
        try:
            self.realm.clear()
            self.address = choose_address(self.realm, self._launch.params.hub.transport)
            if self._launch.patient:
                self.address = replace(self.address, lease_ms=LEASE_PATIENT_MS)
            if self._launch.guarded:
                self.address = _with_password(self.address, secrets.token_hex(8))
                self._guarded = [
                    _with_password(self.address, name) for name in self._launch.params.processes
                ]
            logs.probe(self.realm.folder)
            self._write_files()
        except OSError as error:
            raise QuadctlError(
                f"{self.realm.folder} cannot be written: {error.strerror}",
                "make room on its disk, or set XDG_RUNTIME_DIR to a folder on another",
            ) from error

    def _write_files(self) -> None:
        live.save_all_values(self.realm, self._launch.fleet)
        write_addresses(self.realm, self.address, self._guarded)

    def __enter__(self) -> Self:
        try:
            self._take()
        except BaseException:
            self.remove()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.remove()
