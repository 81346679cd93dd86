"""Facts of the machine: processes where there is /proc, and disks."""

import contextlib
import os
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

from services.runtime.procfs import pss_of, stats_of


class Process(NamedTuple):
    """A process: its state's letter as /proc says it, empty where it has ended, `?` unknown.

    `seconds` of processor time so far; `memory` is its share (PSS), bytes; both 0 where unknown.
    """

    state: str
    seconds: float = 0.0
    memory: int = 0


class Disk(NamedTuple):
    """A folder's disk: free bytes, and why nothing can be written there, empty where it can."""

    folder: str
    free: int
    refused: str = ""


def process(pid: int) -> Process:
    """Look at a process of ours."""
    stats = stats_of(pid)
    if stats.state is not None:
        return Process(stats.state, stats.cpu or 0.0, pss_of(pid) or 0)
    if sys.platform == "win32":
        # Signal 0 would end it there.
        return Process("?")
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return Process("")
    except PermissionError:
        pass
    return Process("?")


def disk(folder: Path, *, writing: bool) -> Disk:
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
    return Disk(str(folder), shutil.disk_usage(folder).free, refused)
