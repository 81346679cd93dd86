"""Names of a fleet: issued, listed, revoked."""

import logging
import re
import shutil
import time
from contextlib import suppress
from pathlib import Path
from secrets import token_hex

import msgspec

from quadctl.schemas.roles import Role
from quadctl.schemas.typed import from_json
from quadctl.services.runtime.errors import Invalid, QuadctlError, UsageError
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.files import write_whole
from quadctl.services.runtime.params.names import nearest
from quadctl.services.runtime.realm import vehicle_name, write_atomically
from quadctl.services.runtime.security.authority import Authority, hosts_here
from quadctl.services.runtime.security.identity import ABOUT, Name

LIST = "names.json"
_log = logging.getLogger(__name__)
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")


def checked(name: str) -> str:
    """Return a holder's name, also a folder's name; raises UsageError if it is not valid."""
    if not _NAME.fullmatch(name):
        raise UsageError(
            f"'{name}' is no name for a certificate",
            "use at most 40 letters, digits, '_' or '-', the first a letter or digit",
        )
    return name


def checked_vehicles(names: list[str]) -> list[str]:
    """Return the vehicles of a role, all if none is named; raises UsageError for a bad name."""
    return sorted({vehicle_name(name) for name in names}) or ["*"]


def load(folder: Path) -> list[Name]:
    """Load the list of a folder; raises UsageError if it cannot be read, Invalid if damaged."""
    file = folder / LIST
    try:
        return from_json(file.read_bytes(), list[Name])
    except FileNotFoundError as error:
        raise UsageError(
            f"{file} is not there", "`quadctl keys init` makes a fleet's keys, `keys issue` a hub's"
        ) from error
    except OSError as error:
        raise UsageError(f"{file} cannot be read: {error.strerror}") from error
    except msgspec.DecodeError as error:
        hint = "copy it from another folder of the fleet"
        raise Invalid(f"{file} is not a list of names: {error}", hint) from error


def save(folder: Path, names: list[Name]) -> None:
    """Write the list; raises OSError."""
    write_atomically(folder / LIST, msgspec.json.format(msgspec.json.encode(names)) + b"\n")


_DAY = 86_400


class Registry:
    """Folder with the fleet's keys, its list of names, and one folder per name."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def init(self) -> None:
        """Make a new fleet; raises UsageError if the folder has one already."""
        Authority.found(self._folder)
        save(self._folder, [])

    def names(self) -> list[Name]:
        """Return all names; raises UsageError if there is no fleet."""
        return load(self._folder)

    def issue(
        self, role: Role, vehicles_of: dict[str, list[str]], days: float, hosts: list[str]
    ) -> list[Name]:
        """Issue certificates, one folder per name; an earlier certificate of a name is revoked.

        `vehicles_of` has the role's vehicles for each name.
        """
        expires, hosts = time.time() + days * _DAY, hosts or hosts_here()
        made = [Name(name, role, of, token_hex(4), expires) for name, of in vehicles_of.items()]
        authority = Authority(self._folder)
        with self._lock():
            others = [known for known in self.names() if known.name not in vehicles_of]
            for name in made:
                authority.issue(name, hosts, self.folder_of(name))
                write_whole(self.folder_of(name) / ABOUT, msgspec.json.encode(name))
            self._save([*others, *made])
        return made

    def folder_of(self, name: Name) -> Path:
        """Return the folder of a name's identity."""
        return self._folder / name.name

    def revoke(self, name: str) -> Name:
        """Remove a name and its folder; raises Invalid if there is no such name."""
        with self._lock():
            known = {each.name: each for each in self.names()}
            if name not in known:
                hint = nearest(name, known) or "`quadctl keys list` shows all"
                raise Invalid(f"there is no certificate {name}", hint)
            revoked = known.pop(name)
            self._save(list(known.values()))
            with suppress(FileNotFoundError):
                shutil.rmtree(self._folder / name)
        return revoked

    def _save(self, known: list[Name]) -> None:
        # A hub's machine has only the hub's folder, so each hub's folder has a copy of the list.
        folders = [self.folder_of(name) for name in known if name.role == "hub"]
        try:
            for folder in (self._folder, *filter(Path.is_dir, folders)):
                save(folder, known)
        except OSError as error:
            raise QuadctlError(
                f"the list of names cannot be written: {error.strerror}", "is the disk full?"
            ) from error

    def _lock(self) -> FileLock:
        self.names()
        return FileLock(self._folder / ".lock", f"the fleet {self._folder}")


class NameList:
    """List of names in a folder, read again and again.

    While its file cannot be read, e.g. as it is just copied there, the last list stays in force.
    """

    def __init__(self, folder: str) -> None:
        """Read the list; raises as `load`."""
        self._folder = Path(folder)
        self.known, self._is_readable = load(self._folder), True

    def changed(self) -> list[Name] | None:
        """Return the list after each change, else None."""
        try:
            now = load(self._folder)
        except QuadctlError as problem:
            if self._is_readable:
                _log.warning("%s; the last list stays in force. %s", problem.message, problem.hint)
            self._is_readable = False
            return None
        self._is_readable = True
        if now == self.known:
            return None
        self.known = now
        return now
