"""Launch of a run: its settings, its lock on the realm, its files."""

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

import msgspec
from msgspec import Struct

from quadctl.schemas.params import Params
from quadctl.services.runtime import run_files
from quadctl.services.runtime.bus.session import Address
from quadctl.services.runtime.errors import AlreadyServed, Invalid, QuadctlError
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.params import live
from quadctl.services.runtime.process_table import Process, table
from quadctl.services.runtime.realm import Realm, write_atomically
from quadctl.services.runtime.run_files import ProcessRecord, RunState
from quadctl.services.runtime.security import endpoints
from quadctl.services.runtime.shutdown import uninterrupted
from quadctl.services.runtime.supervisor import logs

_ATTEMPTS = 100


class Launch(Struct, frozen=True):
    """All that a supervisor needs to know: each vehicle's parameters among it.

    `[processes]` commands run in `folder`. The run is recorded to the file `record`, where one is
    named. `insecure` says that plain endpoints may reach beyond this machine. One that is `owned` ends
    with who started it.
    """

    realm: str
    fleet: dict[str, Params]
    without: list[str]
    folder: str
    record: str = ""
    insecure: bool = False
    owned: bool = False

    @property
    def vehicles(self) -> list[str]:
        """The names of the vehicles."""
        return list(self.fleet)

    @property
    def params(self) -> Params:
        """What is the same for all vehicles: the first one's tables of the hub and the run."""
        return self.fleet[self.vehicles[0]]

    def processes(self) -> tuple[Process, ...]:
        """What is to run; raises Invalid for a command, or a hub, that is not there.

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
        rows = table(self.params.processes, self.without, gate=bool(gate), record=bool(self.record))
        self._check_hub(rows)
        path = self.environment(0)["PATH"]
        for process in rows:
            program = process.command[0]
            # As the child will: a path is looked up from the file's folder, a word on PATH.
            there = Path(self.folder) / program if Path(program).name != program else program
            if process.stranger and shutil.which(there, path=path) is None:
                raise Invalid(
                    f"processes.{process.name}: {program} is not there, or cannot be run",
                    "give a command that this shell would find",
                )
        return rows

    def _check_hub(self, rows: tuple[Process, ...]) -> None:
        needs = [process.name for process in rows if process.must_announce]
        if needs and "hub" not in needs and not _answers(Realm(self.realm).socket):
            raise Invalid(
                f"--without hub: {', '.join(needs)} meet at it, and the realm {self.realm} has none",
                f"start one first: python -P -m quadctl.services.hub --realm {self.realm}",
            )

    def environment(self, restarts: int) -> dict[str, str]:
        """What a child finds in its environment beside ours."""
        # `python` in a command means the interpreter that has quadctl.
        who = os.environ.get("QUADCTL_IDENTITY")
        path = os.pathsep.join((sysconfig.get_path("scripts"), os.environ.get("PATH", "")))
        return {
            "QUADCTL_REALM": self.realm,
            "QUADCTL_VEHICLES": ",".join(self.vehicles),
            "QUADCTL_VEHICLE": self.vehicles[0] if len(self.vehicles) == 1 else "",
            "QUADCTL_RESTARTS": str(restarts),
            "QUADCTL_SUPERVISED": "1",
            "QUADCTL_RECORD": self.record,
            "QUADCTL_INSECURE": "1" if self.insecure else "",
            # Children stand in another folder.
            "QUADCTL_IDENTITY": str(Path(who).absolute()) if who else "",
            "PYTHONUNBUFFERED": "1",
            "PATH": path,
        }


def hold(realm: Realm) -> FileLock:
    """Take the realm for a supervisor; raises AlreadyServed, naming its holder's pid."""
    hint = f"`quadctl down --realm {realm.name}` ends it; another --realm runs beside it"
    lock = FileLock(realm.lock, f"the realm {realm.name}", hint)
    for _ in range(_ATTEMPTS):
        # A run that is just ending removes the folder under us.
        with contextlib.suppress(FileNotFoundError):
            realm.create()
            return lock.acquire()
    raise QuadctlError(f"{realm.folder} cannot be made", "set XDG_RUNTIME_DIR to another folder")


def _answers(path: Path) -> bool:
    """Whether somebody listens on a Unix socket."""
    if sys.platform == "win32":
        return False
    with socket.socket(socket.AF_UNIX) as probe:
        return probe.connect_ex(str(path)) == 0


def choose_address(realm: Realm, transport: str) -> Address:
    """Where this run's hub shall listen, written to the realm's folder for all to find."""
    unix = hasattr(socket, "AF_UNIX") and sys.platform != "win32"
    if transport == "unix" or (transport == "auto" and unix):
        return Address(realm.endpoint)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    return Address(f"tcp/127.0.0.1:{port}", secrets.token_hex(8), secrets.token_hex(16))


class RunDirectory:
    """Holds the realm within a `with` block, and leaves nothing of the run behind."""

    def __init__(self, launch: Launch) -> None:
        """The realm is taken where the block begins, which raises AlreadyServed when it is live."""
        self.realm, self._launch = Realm(launch.realm), launch
        self._lock: FileLock
        self._is_held = self._lost = False

    def write(self, rows: list[ProcessRecord]) -> None:
        """Write the record; raises OSError."""
        run = RunState(self.realm.name, os.getpid(), self._launch.vehicles, rows)
        run_files.write(self.realm, run)

    def repair(self, tell: Callable[[str], None]) -> bool:
        """Make the folder anew where somebody has removed it; whether it was made.

        Raises AlreadyServed where another run has taken the realm meanwhile.
        """
        if self._lock.stands():
            return False
        if not self._lost:
            self._lost = True
            tell(f"{self.realm.folder} was removed under the run")
        try:
            self._lock.release()
            self._lock = hold(self.realm)
            self._write_files()
        except AlreadyServed:
            raise
        except (OSError, QuadctlError):
            # Told already; the next look tries again.
            return False
        self._lost = False
        tell(f"{self.realm.folder} was made anew, with the parameters of the launch")
        return True

    def remove(self) -> None:
        """Remove the folder, unless it is another run's by now."""
        if not self._is_held:
            return
        if self._lock.stands():
            self.realm.remove()
        self._lock.release()

    def _take(self) -> None:
        self._lock, self._is_held = hold(self.realm), True
        try:
            self.realm.clear()
            self.address = choose_address(self.realm, self._launch.params.hub.transport)
            logs.probe(self.realm.folder)
            self._write_files()
        except OSError as error:
            raise QuadctlError(
                f"{self.realm.folder} cannot be written: {error.strerror}",
                "make room on its disk, or set XDG_RUNTIME_DIR to a folder on another",
            ) from error

    def _write_files(self) -> None:
        live.save_all_values(self.realm, self._launch.fleet)
        write_atomically(self.realm.address, msgspec.json.encode(self.address))

    def __enter__(self) -> Self:
        try:
            with uninterrupted():
                self._take()
        except BaseException:
            self.remove()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.remove()
