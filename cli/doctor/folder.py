"""Facts of the realm: its folder, its supervisor, its run record, and its neighbours."""

import os
import stat
from pathlib import Path
from typing import NamedTuple

import msgspec

from services.runtime.filelock import FileLock
from services.runtime.realm import Realm
from services.runtime.run_files import RunRecord, is_live

_SAID_LAST = 5
"""Lines of a dead process's log that are shown."""


class Folder(NamedTuple):
    """A realm's folder; `mode` and `owned` are None where it is not there.

    `live`: a supervisor holds it, `holder` as it wrote itself down. `by_hand`: some process of it
    runs without one. `socket`: what the hub listens on is there. `last`: the log's last lines.
    """

    path: str
    mode: int | None
    owned: bool
    live: bool
    holder: str
    by_hand: bool
    socket: bool
    run: RunRecord | None
    last: dict[str, str]


class Neighbours(NamedTuple):
    """The other realms in the same place, by name: those that run, and those that have died."""

    root: str
    live: list[str]
    dead: list[str]


def folder(realm: Realm) -> Folder:
    """Look at a realm."""
    try:
        found = realm.folder.stat()
    except (FileNotFoundError, PermissionError) as error:
        owned = isinstance(error, FileNotFoundError)
        return Folder(str(realm.folder), None, owned, False, "", False, False, None, {})
    posix = hasattr(os, "getuid")
    run = _record(realm)
    return Folder(
        path=str(realm.folder),
        mode=stat.S_IMODE(found.st_mode) if posix else None,
        owned=not posix or found.st_uid == os.getuid(),
        live=is_live(realm),
        holder=_text(realm.lock).strip(),
        by_hand=_is_held(realm.folder),
        socket=realm.socket.exists() or "unixsock" not in _text(realm.address),
        run=run,
        last={node.name: _last(realm.logs / f"{node.name}.log") for node in run.nodes}
        if run
        else {},
    )


def neighbours(realm: Realm) -> Neighbours:
    """Look at the other realms."""
    root = realm.folder.parent
    names = [path.name for path in _folders(root) if path.name != realm.name]
    live = sorted(name for name in names if _is_held(root / name))
    return Neighbours(str(root), live, sorted(set(names) - set(live)))


def _folders(root: Path) -> list[Path]:
    try:
        return [path for path in root.iterdir() if path.is_dir()]
    except OSError:
        return []


def _is_held(path: Path) -> bool:
    """Whether any process holds a lock in a realm's folder; one of another user's counts as held."""
    try:
        return any(FileLock(lock, "").held() for lock in path.glob("*.lock"))
    except OSError:
        return True


def _record(realm: Realm) -> RunRecord | None:
    try:
        return msgspec.json.decode(realm.record.read_bytes(), type=RunRecord)
    except (OSError, msgspec.DecodeError):
        return None


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _last(path: Path) -> str:
    return "\n".join(_text(path).splitlines()[-_SAID_LAST:])
