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
from quadctl.schemas.typed import from_json
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.procfs import pss_of, stats_of
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import RunState, is_live


class ProcessFacts(NamedTuple):
    """Process with the letter of its state in /proc, empty if it has ended, `?` if unknown.

    `seconds` is its processor time, `memory` its share (PSS) in bytes; both are 0 if unknown.
    """

    state: str
    seconds: float = 0.0
    memory: int = 0


class DiskSpace(NamedTuple):
    """Free bytes on a folder's disk, and why a write there is refused, empty if it is not."""

    folder: str
    free: int
    refused: str = ""


def process(pid: int) -> ProcessFacts:
    """Return the facts about one of our processes."""
    stats = stats_of(pid)
    if stats.state is not None:
        return ProcessFacts(stats.state, stats.cpu or 0.0, pss_of(pid) or 0)
    if sys.platform == "win32":
        # On Windows, signal 0 would end the process.
        return ProcessFacts("?")
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return ProcessFacts("")
    except PermissionError:
        pass
    return ProcessFacts("?")


def look_at_disk(folder: Path, *, writing: bool) -> DiskSpace:
    """Measure a disk; with `writing`, write a small file there and remove it."""
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
"""Share of one core."""
_LARGE = 200 * MB
_FIRST_YEAR = 2024


def disk(disks: Sequence[DiskSpace]) -> Finding:
    """Check the room for logs, recordings and the run's files."""
    for found in disks:
        if found.refused:
            fix = f"`df {found.folder}` and `ls -ld {found.folder}` show why"
            return failed("disk", f"{found.folder} cannot be written to: {found.refused}", fix)
    least = min(disks, key=lambda found: found.free)
    evidence = f"{least.free / MB:.0f} MB free at {least.folder}"
    fix = f"`df -h {least.folder}`, and remove what is not needed"
    if least.free < _NONE:
        return failed("disk", evidence, fix)
    return warned("disk", evidence, fix) if least.free < _SCARCE else passed("disk", evidence)


def clock(year: int) -> Finding:
    """Check the system's clock, which sets the deadlines of calls."""
    if year < _FIRST_YEAR:
        return failed("clock", f"it is the year {year}", "`timedatectl set-ntp true`")
    return passed("clock", f"it is the year {year}")


def load(
    before: Mapping[str, ProcessFacts], after: Mapping[str, ProcessFacts], seconds: float
) -> Finding:
    """Check the processes' share of a core and of the memory; unknown without /proc."""
    # The counter of a process restarted in between has begun at 0 again.
    cores = {
        name: max(after[name].seconds - then.seconds, 0) / seconds
        for name, then in before.items()
        if name in after and seconds
    }
    greedy = [f"{name} takes {use:.0%} of a core" for name, use in cores.items() if use > _BUSY]
    large = [(name, now.memory) for name, now in after.items() if now.memory > _LARGE]
    greedy += [f"{name} takes {memory / MB:.0f} MB" for name, memory in large]
    if greedy:
        fix = "`quadctl param get dynamics`: a high rate, or a speed other than 1, costs much time"
        return warned("load", ", ".join(greedy), fix)
    memory = sum(process.memory for process in after.values())
    if not memory:
        return passed("load", "not known on this system")
    return passed("load", f"{sum(cores.values()):.0%} of a core, {memory / MB:.0f} MB in all")


class Folder(NamedTuple):
    """Facts about a realm's folder; `mode` is None if it is missing or the system has no modes.

    `live`: a supervisor holds it, `holder` is the pid in the lock. `by_hand`: a process of it runs
    without a supervisor. `socket`: the hub's socket exists. `logs`: lines of each node's log.
    """

    path: str
    mode: int | None
    live: bool
    holder: str
    by_hand: bool
    socket: bool
    run: RunState | None
    logs: dict[str, list[str]]


class Neighbours(NamedTuple):
    """Names of the other realms in the same folder: live ones and dead ones."""

    root: str
    live: list[str]
    dead: list[str]


def folder(realm: Realm) -> Folder:
    """Return the facts about a realm's folder."""
    try:
        found = realm.folder.stat()
    except (FileNotFoundError, PermissionError):
        return Folder(str(realm.folder), None, False, "", False, False, None, {})
    posix = hasattr(os, "getuid")
    run = _record(realm)
    return Folder(
        path=str(realm.folder),
        mode=stat.S_IMODE(found.st_mode) if posix else None,
        live=is_live(realm),
        holder=_text(realm.lock).strip(),
        by_hand=_is_held(realm.folder),
        socket=realm.socket.exists() or "unixsock" not in _text(realm.address),
        run=run,
        logs={node.name: _text(realm.logs / f"{node.name}.log").splitlines() for node in run.nodes}
        if run
        else {},
    )


def neighbours(realm: Realm) -> Neighbours:
    """Return the names of the other realms."""
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
    """Return whether a process holds a lock in a realm's folder; another user's counts as held."""
    try:
        return any(FileLock(lock, "").held() for lock in path.glob("*.lock"))
    except OSError:
        return True


def _record(realm: Realm) -> RunState | None:
    try:
        return from_json(realm.record.read_bytes(), RunState)
    except (OSError, msgspec.DecodeError):
        return None


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
