"""Realm: one isolated run of the system, and its folder."""

import contextlib
import errno
import os
import stat
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from quadctl.services.runtime.errors import QuadctlError, UsageError

if TYPE_CHECKING:
    from pathlib import Path

DEFAULT = "uav"
"""Default name of a vehicle."""
HUB_ALONE = "hub-"
"""Prefix of the name that a hub without a vehicle uses instead of a vehicle's."""
_MOST_LISTED = 12
_LONGEST_NAME = 40
ADDRESS = "hub.json"
"""File in a realm's folder with the address of its hub."""
RECORD = "run.json"
"""File with the state of the run, replaced at every change."""
LOCK = "up.lock"
"""Lock file that the run holds for as long as it lives."""
_OWN_FOLDER = "set XDG_RUNTIME_DIR to a folder of your own"
_LONGEST_SOCKET_PATH = 100
"""Bytes; the kernel's sun_path holds 108, and Zenoh adds a suffix for its lock."""


def vehicle_name(name: str) -> str:
    """Return the name if it can be the first chunk of a key; raises UsageError otherwise."""
    return _checked(name, "a vehicle")


def _checked(name: str, what: str) -> str:
    plain = name.replace("_", "a").replace(".", "a").replace("-", "a")
    if not (
        name.isascii() and plain.isalnum() and name[0].isalnum() and len(name) <= _LONGEST_NAME
    ):
        raise UsageError(
            f"'{name}' is not a valid name for {what}",
            "use at most 40 letters, digits, '.', '_' or '-', the first a letter or digit",
        )
    return name


def listed(vehicles: Sequence[str]) -> str:
    """Return the names for a message; of many, only the first and the last."""
    if len(vehicles) <= _MOST_LISTED:
        return ", ".join(vehicles)
    return f"{vehicles[0]} .. {vehicles[-1]} ({len(vehicles)})"


def default_name() -> str:
    """Return the realm of this shell: `QUADCTL_REALM`, else `default`."""
    return os.environ.get("QUADCTL_REALM") or "default"


class _Within:
    """Path in a realm's folder, built on access: a call needs none, and pathlib is slow."""

    def __init__(self, name: str = "") -> None:
        self._name = name

    def __get__(self, realm: "Realm", _type: object) -> "Path":
        from pathlib import Path

        return Path(realm.path, self._name)


class Realm:
    """Folder of one run: socket, logs, record; `path` as a string. The object creates no file."""

    folder = _Within()
    socket = _Within("hub.sock")
    address = _Within(ADDRESS)
    record = _Within(RECORD)
    lock = _Within(LOCK)
    params = _Within("params")
    logs = _Within("logs")
    restart_requests = _Within("asked")

    def __init__(self, name: str) -> None:
        self.name = _checked(name, "a realm")
        self.path = os.path.join(_root(), name)
        self.endpoint = f"unixsock-stream/{self.path}/hub.sock"
        if len(os.fsencode(self.path)) + len("/hub.sock") > _LONGEST_SOCKET_PATH:
            raise UsageError(
                f"the socket's path is too long for a Unix socket: {self.socket}",
                "choose a shorter --realm, or set XDG_RUNTIME_DIR to a shorter folder",
            )
        for folder in (os.path.dirname(self.path), self.path):
            _check_own(folder)

    def create(self) -> None:
        """Create the folder, readable by its owner alone; raise QuadctlError if it cannot be."""
        for folder in (self.folder.parent, self.folder):
            try:
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                _check_own(str(folder))
                folder.chmod(0o700)
            except FileNotFoundError:
                raise  # a run that is just ending has removed it again
            except OSError as error:
                raise QuadctlError(
                    f"{folder} cannot be created: {error.strerror}", _OWN_FOLDER
                ) from error

    def clear(self) -> None:
        """Remove what a killed run left, except locks and sockets: others may hold them."""
        self._remove(lambda path: path.suffix not in {".lock", ".sock"})

    def remove(self, *, but_logs: bool = False) -> None:
        """Remove the folder, the lock file last: no other run can take the realm in between.

        With `but_logs` the logs stay, until the next run of the realm.
        """
        kept = {self.lock, self.logs} if but_logs else {self.lock}
        self._remove(lambda path: path not in kept)
        self.lock.unlink(missing_ok=True)
        # A new run may be creating its own files by now.
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def _remove(self, chosen: Callable[["Path"], bool]) -> None:
        for path in filter(chosen, self.folder.iterdir()):
            if path.is_dir() and not path.is_symlink():
                _remove_tree(path)
            else:
                path.unlink(missing_ok=True)


def _remove_tree(path: "Path") -> None:
    import shutil

    try:
        shutil.rmtree(path)
    except OSError as error:
        if error.errno != errno.ENOTEMPTY:
            raise
        shutil.rmtree(path)  # a request to restart a node came into it meanwhile


def spare_folder(name: str) -> "Path":
    """Return a folder of this user alone beside the realms, and create it, e.g. for want of a home."""
    from pathlib import Path

    folder = Path(f"{_root()}-{name}")
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    _check_own(str(folder))
    return folder


def _check_own(folder: str) -> None:
    """Raise UsageError if a folder is a link or another user's, or lies in one that is closed to us.

    Anybody may create it first in /tmp: files of ours would be removed behind a link, and we would
    fly through another user's hub.
    """
    if sys.platform == "win32":
        return
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        try:
            found = os.lstat(folder)
        except PermissionError as error:
            raise UsageError(f"{folder} is closed to this user", _OWN_FOLDER) from error
        if stat.S_ISLNK(found.st_mode):
            raise UsageError(f"{folder} is a link, which is not followed", _OWN_FOLDER)
        if found.st_uid != os.getuid():
            raise UsageError(f"{folder} belongs to another user", _OWN_FOLDER)


def _root() -> str:
    if runtime := _absolute("XDG_RUNTIME_DIR"):
        return os.path.join(runtime, "quadctl")
    if sys.platform == "win32":
        own = f"quadctl-{os.environ.get('USERNAME', 'user')}"
        return os.path.join(os.environ["TEMP"], own)
    # The result of tempfile.gettempdir(), without its 15 ms of import in every command.
    return os.path.join(_absolute("TMPDIR") or "/tmp", f"quadctl-{os.getuid()}")  # noqa: S108


def _absolute(variable: str) -> str:
    value = os.environ.get(variable, "")
    if value and not os.path.isabs(value):
        # Processes with different working directories would use different folders.
        raise UsageError(
            f"{variable} is {value}, a relative path", f"set it to {os.path.abspath(value)}"
        )
    return value


def write_atomically(path: "Path", data: bytes, mode: int = 0o666) -> None:
    """Replace a file so that a reader sees the old or the new text, never a part.

    No other user can do more with it, at any time, than the `mode` permits.
    """
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    fresh.unlink(missing_ok=True)  # of a process with this number that was killed
    try:
        with open(fresh, "xb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
            file.write(data)
        fresh.replace(path)
    except BaseException:  # also a Ctrl-C
        fresh.unlink(missing_ok=True)
        raise
