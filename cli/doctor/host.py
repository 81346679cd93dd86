"""Checks of the machine: disk, processor, clock, and the folder of a realm."""

import contextlib
import os
import shutil
import stat
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from quadctl.cli.doctor.check import Finding, failed, passed, warned
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.procfs import pss_of, stats_of
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import RunState, is_live


class ProcessFacts(NamedTuple):
    """A process: its state's letter as /proc says it, empty where it has ended, `?` unknown.

    `seconds` of processor time so far; `memory` is its share (PSS), bytes; both 0 where unknown.
    """

    state: str
    seconds: float = 0.0
    memory: int = 0


class DiskSpace(NamedTuple):
    """A folder's disk: free bytes, and why nothing can be written there, empty where it can."""

    folder: str
    free: int
    refused: str = ""


def process(pid: int) -> ProcessFacts:
    """Look at a process of ours."""
    stats = stats_of(pid)
    if stats.state is not None:
        return ProcessFacts(stats.state, stats.cpu or 0.0, pss_of(pid) or 0)
    if sys.platform == "win32":
        # Signal 0 would end it there.
        return ProcessFacts("?")
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return ProcessFacts("")
    except PermissionError:
        pass
    return ProcessFacts("?")


def look_at_disk(folder: Path, *, writing: bool) -> DiskSpace:
    """Look at a disk; with `writing`, write a small file there and remove it."""
    refused = ""
    if writing:
        trial = folder / f".doctor.{os.getpid()}"
        try:
            trial.write_bytes(b"doctor\n" * 100)
        except OSError as error:
            refused = error.strerror or str(error)
        with contextlib.suppress(OSError):
            trial.unlink()
    return DiskSpace(str(folder), shutil.disk_usage(folder).free, refused)


MB = 1e6
_SCARCE, _NONE = 200 * MB, 10 * MB
_BUSY = 0.9
"""Of one core."""
_LARGE = 200 * MB
_FIRST_YEAR = 2024


def disk(disks: Sequence[DiskSpace]) -> Finding:
    """Room for logs, recordings and the run's files."""
    for found in disks:
        if found.refused:
            return failed(
                "disk",
                f"{found.folder} cannot be written to: {found.refused}",
                f"`df {found.folder}` and `ls -ld {found.folder}` say why",
            )
    least = min(disks, key=lambda found: found.free)
    said = f"{least.free / MB:.0f} MB free at {least.folder}"
    fix = f"`df -h {least.folder}`, and remove what is not needed"
    if least.free < _NONE:
        return failed("disk", said, fix)
    return warned("disk", said, fix) if least.free < _SCARCE else passed("disk", said)


def clock(year: int) -> Finding:
    """The system's clock, by which calls have their deadline."""
    if year < _FIRST_YEAR:
        return failed("clock", f"it is the year {year}", "`timedatectl set-ntp true`")
    return passed("clock", f"it is the year {year}")


def load(
    before: Mapping[str, ProcessFacts], after: Mapping[str, ProcessFacts], seconds: float
) -> Finding:
    """What the processes take of a core and of the memory; unknown where there is no /proc."""
    # A process that has been started again in between has begun to count anew.
    cores = {
        name: max(after[name].seconds - then.seconds, 0) / seconds
        for name, then in before.items()
        if name in after and seconds
    }
    greedy = [f"{name} takes {use:.0%} of a core" for name, use in cores.items() if use > _BUSY]
    greedy += [
        f"{name} takes {now.memory / MB:.0f} MB"
        for name, now in after.items()
        if now.memory > _LARGE
    ]
    if greedy:
        return warned(
            "load",
            ", ".join(greedy),
            "`quadctl param get dynamics`: a high rate, or a speed other than 1, takes what it gets",
        )
    memory = sum(process.memory for process in after.values())
    if not memory:
        return passed("load", "this system does not tell")
    return passed("load", f"{sum(cores.values()):.0%} of a core, {memory / MB:.0f} MB in all")


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
    run: RunState | None
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


def _record(realm: Realm) -> RunState | None:
    try:
        return msgspec.json.decode(realm.record.read_bytes(), type=RunState)
    except (OSError, msgspec.DecodeError):
        return None


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _last(path: Path) -> str:
    return "\n".join(_text(path).splitlines()[-_SAID_LAST:])
