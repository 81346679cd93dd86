"""Names of a fleet: issued, listed, revoked."""

import re
import shutil
import time
from contextlib import suppress
from pathlib import Path
from secrets import token_hex

import msgspec

from quadctl.schemas.roles import Role
from quadctl.services.runtime.errors import Invalid, QuadctlError, UsageError
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.params.names import nearest
from quadctl.services.runtime.realm import vehicle_name, write_atomically
from quadctl.services.runtime.security.authority import Authority, hosts_here
from quadctl.services.runtime.security.identity import ABOUT, Name

LIST = "names.json"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")


def checked(name: str) -> str:
    """A holder's name, which also names a folder; raises UsageError for what cannot be one."""
    if not _NAME.fullmatch(name):
        raise UsageError(
            f"'{name}' is no name for a certificate",
            "use at most 40 letters, digits, '_' or '-', the first a letter or digit",
        )
    return name


def checked_vehicles(said: list[str]) -> list[str]:
    """The vehicles that a role is for, all where none is said; raises UsageError."""
    return sorted({vehicle_name(vehicle) for vehicle in said}) or ["*"]


def load(folder: Path) -> list[Name]:
    """The list of a folder; raises UsageError where there is none, Invalid where it is none."""
    file = folder / LIST
    try:
        return msgspec.json.decode(file.read_bytes(), type=list[Name])
    except FileNotFoundError as error:
        raise UsageError(
            f"{file} is not there", "`quadctl keys init` makes a fleet's keys, `keys issue` a hub's"
        ) from error
    except OSError as error:
        raise UsageError(f"{file} cannot be read: {error.strerror}") from error
    except msgspec.DecodeError as error:
        raise Invalid(f"{file} is no list of names: {error}", "`quadctl keys list` reads it") from (
            error
        )


def save(folder: Path, names: list[Name]) -> None:
    """Write the list; raises OSError."""
    write_atomically(folder / LIST, msgspec.json.format(msgspec.json.encode(names)) + b"\n")


_DAY = 86_400


class Registry:
    """The folder with the fleet's keys, its list of names, and a folder for each of them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def init(self) -> None:
        """Make a new fleet; raises UsageError where there is one already."""
        Authority.found(self._folder)
        save(self._folder, [])

    def names(self) -> list[Name]:
        """All names; raises UsageError where there is no fleet."""
        return load(self._folder)

    def issue(
        self, role: Role, vehicles_of: dict[str, list[str]], days: float, hosts: list[str]
    ) -> list[Name]:
        """New certificates, each in a folder that has its name; one that a name had is good no more.

        `vehicles_of` says by name what the role is for.
        """
        expires, hosts = time.time() + days * _DAY, hosts or hosts_here()
        made = [
            Name(name, role, vehicles, token_hex(4), expires)
            for name, vehicles in vehicles_of.items()
        ]
        authority = Authority(self._folder)
        with self._lock():
            others = [known for known in self.names() if known.name not in vehicles_of]
            for name in made:
                authority.issue(name, hosts, self.folder_of(name))
                self._write(self.folder_of(name) / ABOUT, msgspec.json.encode(name))
            self._tell([*others, *made])
        return made

    def folder_of(self, name: Name) -> Path:
        """Where its identity is."""
        return self._folder / name.name

    def revoke(self, name: str) -> Name:
        """Take a name from the list, and remove its folder; raises Invalid where it is not there."""
        with self._lock():
            known = {each.name: each for each in self.names()}
            if name not in known:
                hint = nearest(name, known) or "`quadctl keys list` shows all"
                raise Invalid(f"nobody is called {name}", hint)
            gone = known.pop(name)
            self._tell(list(known.values()))
            with suppress(FileNotFoundError):
                shutil.rmtree(self._folder / name)
        return gone

    def _tell(self, known: list[Name]) -> None:
        # The hubs' folders have the list too: a hub is given its folder, and nothing else.
        folders = [self.folder_of(name) for name in known if name.role == "hub"]
        try:
            for folder in (self._folder, *filter(Path.is_dir, folders)):
                save(folder, known)
        except OSError as error:
            raise QuadctlError(
                f"the list of names cannot be written: {error.strerror}", "is the disk full?"
            ) from error

    def _write(self, path: Path, data: bytes) -> None:
        try:
            write_atomically(path, data)
        except OSError as error:
            raise QuadctlError(f"{path} cannot be written: {error.strerror}") from error

    def _lock(self) -> FileLock:
        self.names()
        return FileLock(self._folder / ".lock", f"the fleet {self._folder}")
