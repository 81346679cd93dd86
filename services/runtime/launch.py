"""What a run is launched with, and the two ways to launch it: here, or in the background."""

import os
import secrets
import socket
import subprocess
import sys
import sysconfig
import threading

import msgspec
from msgspec import Struct

from schemas.params import Params
from services.runtime.errors import AlreadyServed, QuadctlError
from services.runtime.lock import FileLock
from services.runtime.processes import START_TIMEOUT
from services.runtime.realm import Realm
from services.runtime.session import Address


class Launch(Struct, frozen=True):
    """All that a supervisor needs to know. `[processes]` commands run in `folder`."""

    realm: str
    vehicle: str
    params: Params
    without: list[str]
    folder: str

    def environment(self, restarts: int) -> dict[str, str]:
        """What a child finds in its environment beside ours."""
        # `python` in a command means the interpreter that has quadctl.
        path = os.pathsep.join((sysconfig.get_path("scripts"), os.environ.get("PATH", "")))
        return {
            "QUADCTL_REALM": self.realm,
            "QUADCTL_VEHICLE": self.vehicle,
            "QUADCTL_RESTARTS": str(restarts),
            "QUADCTL_SUPERVISED": "1",
            "PYTHONUNBUFFERED": "1",
            "PATH": path,
        }


class Settled(Struct, frozen=True):
    """What a background supervisor says once: ready when `failed` is empty."""

    failed: str = ""
    code: str = ""
    hint: str = ""


def hold(realm: Realm) -> FileLock:
    """Take the realm for a supervisor; raises AlreadyServed, naming its holder's pid."""
    realm.create()
    hint = f"`quadctl down --realm {realm.name}` ends it; another --realm runs beside it"
    return FileLock(realm.lock, f"the realm {realm.name}", hint).acquire()


def choose_address(realm: Realm, transport: str) -> Address:
    """Where this run's hub shall listen, written to the realm's folder for all to find."""
    unix = hasattr(socket, "AF_UNIX") and sys.platform != "win32"
    if transport == "unix" or (transport == "auto" and unix):
        return Address(f"unixsock-stream/{realm.socket}")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    return Address(f"tcp/127.0.0.1:{port}", secrets.token_hex(8), secrets.token_hex(16))


def detach(launch: Launch) -> None:
    """Start a supervisor in the background, and return when it says that all are ready.

    Raises AlreadyServed where the realm is live, and QuadctlError with the last lines of what
    did not come up; then nothing is left running.
    """
    supervisor = subprocess.Popen(
        [sys.executable, "-P", "-m", "services.runtime.background"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    assert supervisor.stdin is not None  # noqa: S101 - pipes, as asked for above
    assert supervisor.stdout is not None  # noqa: S101
    patience = threading.Timer(2 * START_TIMEOUT, supervisor.kill)
    patience.start()
    try:
        supervisor.stdin.write(msgspec.json.encode(launch))
        supervisor.stdin.close()
        said = supervisor.stdout.read()
    except BaseException:
        # Ctrl-C: what was begun is not left behind.
        supervisor.terminate()
        raise
    finally:
        patience.cancel()
    settled = msgspec.json.decode(said or b"{}", type=Settled)
    if settled.code == AlreadyServed.code:
        raise AlreadyServed(settled.failed, settled.hint)
    if settled.failed or not said:
        supervisor.wait()
        raise QuadctlError(settled.failed or "the supervisor ended at once", settled.hint)
