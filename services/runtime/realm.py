"""A realm: one isolated run of the system, and the folder that everything of it lives in."""

import contextlib
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path

from services.runtime.errors import QuadctlError, UsageError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,39}")
_LONGEST_SOCKET_PATH = 100
"""The kernel's sun_path holds 108 bytes, and Zenoh adds a suffix for its lock."""


def vehicle_name(name: str) -> str:
    """The name, when it can be the first chunk of a key; raises UsageError otherwise."""
    if not _NAME.fullmatch(name):
        raise UsageError(
            f"'{name}' is no name for a vehicle",
            "use at most 40 letters, digits, '.', '_' or '-', the first a letter or digit",
        )
    return name


def default_name() -> str:
    """The realm of this shell: `QUADCTL_REALM`, else `default`."""
    return os.environ.get("QUADCTL_REALM") or "default"


class Realm:
    """Where one run keeps its socket, logs and record. Creating the object touches nothing."""

    def __init__(self, name: str) -> None:
        if not _NAME.fullmatch(name):
            raise UsageError(
                f"'{name}' is no name for a realm",
                "use at most 40 letters, digits, '.', '_' or '-', the first a letter or digit",
            )
        self.name = name
        self.folder = _root() / name
        self.socket = self.folder / "hub.sock"
        self.address = self.folder / "hub.json"
        self.record = self.folder / "run.json"
        self.lock = self.folder / "up.lock"
        self.params = self.folder / "params"
        self.logs = self.folder / "logs"
        self.asked = self.folder / "asked"
        if len(os.fsencode(self.socket)) > _LONGEST_SOCKET_PATH:
            raise UsageError(
                f"the socket's path is too long for a Unix socket: {self.socket}",
                "choose a shorter --realm, or set XDG_RUNTIME_DIR to a shorter folder",
            )

    def create(self) -> None:
        """Make the folder, readable by its owner alone; raises where that cannot be.

        A FileNotFoundError says that a run which is just ending has removed it again.
        """
        own = "set XDG_RUNTIME_DIR to a folder of your own"
        for folder in (self.folder.parent, self.folder):
            try:
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                if sys.platform != "win32" and folder.stat().st_uid != os.getuid():
                    raise QuadctlError(f"{folder} belongs to another user", own)
                folder.chmod(0o700)
            except FileNotFoundError:
                raise
            except OSError as error:
                raise QuadctlError(f"{folder} cannot be made: {error.strerror}", own) from error

    def clear(self) -> None:
        """Remove what a killed run has left, all but locks and sockets: others may have them."""
        self._remove(lambda path: path.suffix not in {".lock", ".sock"})

    def remove(self) -> None:
        """Remove the folder; the lock's file last, so that nobody takes the realm in between."""
        self._remove(lambda path: path != self.lock)
        self.lock.unlink(missing_ok=True)
        # A new run may be creating its own files by now.
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def _remove(self, chosen: Callable[[Path], bool]) -> None:
        import shutil

        for path in filter(chosen, self.folder.iterdir()):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)


def _root() -> Path:
    if runtime := _absolute("XDG_RUNTIME_DIR"):
        return runtime / "quadctl"
    if sys.platform == "win32":
        return Path(os.environ["TEMP"]) / f"quadctl-{os.environ.get('USERNAME', 'user')}"
    # What tempfile.gettempdir() answers, without its 15 ms of import in every command.
    return (_absolute("TMPDIR") or Path("/tmp")) / f"quadctl-{os.getuid()}"  # noqa: S108


def _absolute(variable: str) -> Path | None:
    value = os.environ.get(variable)
    if value and not Path(value).is_absolute():
        # Every process would find another folder there, each from where it stands.
        raise UsageError(
            f"{variable} is {value}, a relative path", f"set it to {Path(value).absolute()}"
        )
    return Path(value) if value else None


def write_atomically(path: Path, data: bytes) -> None:
    """Replace a file so that a reader sees the old text or the new, never a part."""
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        fresh.write_bytes(data)
        fresh.replace(path)
    except OSError:
        # A full disk took the file but not what is in it.
        fresh.unlink(missing_ok=True)
        raise
