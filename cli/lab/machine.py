"""Means of a machine to shut a hand-in in, and the command that does so."""

import json
import os
import re
import socket
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex

from msgspec import Struct
from msgspec.structs import replace

from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.realm import Realm

_HIDDEN = ("cli", "services/safety", "services/pressure")
"""Folders of quadctl that a hand-in does not see: the grader, and the solution."""
_LEAVES_A_CHILD = "import os, time, quadctl; os.fork() or time.sleep(5)"
"""Program for a trial: it has to find Python and quadctl, and its child has to end with it."""
_TRIAL = 30.0
"""Seconds that it may take."""
_CONTROL = Path("/sys/fs/cgroup")
"""Control groups, version 2."""
KILLED = "killed by its limit: "
"""Beginning of a node's last line if it has exceeded a limit."""
_ENDING = 2.0
"""Seconds until killed processes have ended."""


class Limits(Struct, frozen=True):
    """Limits of a hand-in: s of a processor, MB of memory and disk, and threads, of a node.

    `wall` is the last resort, s for all rows: beyond it, a hand-in is not graded.
    """

    seconds: float = 60.0
    wall: float = 1800.0
    memory: int = 1024
    disk: int = 64
    processes: int = 128


class Machine(Struct, frozen=True):
    """Means of a machine: namespaces, another user for each node, the version of Landlock or 0.

    `lacks`: why there are no namespaces. With them a hand-in is shut in completely. `groups`: folder in
    which a control group for a hand-in can be made; without one its memory is counted.
    """

    namespaces: bool = False
    user: bool = False
    landlock: int = 0
    lacks: str = ""
    groups: str = ""

    def gaps(self) -> str:
        """Return what a hand-in could do here all the same, empty if it is shut in completely."""
        if self.namespaces:
            return ""
        found = ["use the network" if self.landlock < 4 else "use the network by UDP"]
        if not self.landlock:
            found.append(f"read or change {'what every user may' if self.user else 'your files'}")
        elif not self.user:
            # It can change their rights, and before version 3 also empty them.
            found.append("spoil your files")
        if not self.user:
            found.append(f"reach {'or end ' if self.landlock < 6 else ''}your programs")
        return ", ".join(found)

    @contextmanager
    def control_group(self, limits: Limits) -> Iterator[str]:
        """Make a control group for one node at a time, and end what is in it with the block; yield its folder.

        Without one it is empty.
        """
        if not self.groups:
            yield ""
            return
        group = Path(self.groups, f"quadctl-lab-{token_hex(8)}")
        group.mkdir()
        try:
            for name, value in (
                ("memory.max", limits.memory << 20),
                ("memory.swap.max", 0),
                ("memory.oom.group", 1),
                ("pids.max", limits.processes),
            ):
                # A kernel may have no swap.
                if (group / name).exists():
                    (group / name).write_text(str(value), "ascii")
            yield str(group)
        finally:
            _remove(group)

    def shut_in(
        self,
        command: list[str],
        folder: Path,
        realm: Path,
        root: Path,
        limits: Limits,
        group: str = "",
    ) -> list[str]:
        """Return the words that run a node's command on a copy of its folder, shut in.

        `root` is an empty folder for it, in one that holds nothing which others may read. `group` is
        its control group, if there is one.
        """
        if sys.platform != "linux":
            return command
        ours = [os.path.abspath(each) for each in sys.modules["quadctl"].__path__]  # noqa: PTH100 - links are kept
        parts = [f"{each}/{part}" for each in ours for part in ("services", "schemas")]
        spec = {
            "namespaces": self.namespaces,
            "user": self.user,
            "landlock": self.landlock,
            "group": group,
            "folder": str(folder),
            "root": str(root),
            "realm": str(realm),
            "shown": [sys.prefix, sys.base_prefix, *sysconfig.get_paths().values(), *ours, *parts],
            "hidden": [f"{each}/{part}" for each in ours for part in _HIDDEN],
            "listed": [os.path.dirname(each) for each in ours],  # noqa: PTH120
            "path": os.pathsep.join((sysconfig.get_path("scripts"), os.defpath)),
            "memory": limits.memory,
            "disk": limits.disk,
            "killed": KILLED,
            "processes": limits.processes,
            "seconds": max(round(limits.seconds), 1),
        }
        file = str(Path(__file__).with_name("sandbox.py"))
        return [sys.executable, "-I", "-S", file, json.dumps(spec), *command]

    @contextmanager
    def without_orphans(self) -> Iterator[None]:
        """End all that the nodes started in this block leave; namespaces leave nothing."""
        if self.namespaces or sys.platform != "linux":
            yield
            return
        from quadctl.cli.lab import sandbox  # it needs Linux

        sandbox.adopt_orphans()
        try:
            yield
        finally:
            sandbox.end_descendants()


def probe() -> Machine:
    """Return what this machine has, found out by trials, the strongest means first."""
    if sys.platform != "linux":
        return Machine(lacks=f"a sandbox needs Linux, and this is {sys.platform}")
    from quadctl.cli.lab import sandbox

    lacks = problem = ""
    for namespaces in (True, False):
        for user in (True, False) if os.getuid() == 0 else (False,):
            machine = Machine(namespaces, user, sandbox.landlock(), lacks)
            if not (problem := _trial(machine)):
                grouped = replace(machine, groups=_groups())
                with suppress(OSError):
                    if grouped.groups and not _trial(grouped):
                        return grouped
                return machine
        lacks = lacks or problem
    raise QuadctlError(f"a hand-in's node cannot be started on this machine: {problem}")


def _groups() -> str:
    """Return the nearest folder in which we may make control groups with limits, empty without one.

    A group that has processes has no groups with limits inside it.
    """
    groups = Path("/proc/self/cgroup").read_text("utf-8")
    own = _CONTROL / "".join(re.findall(r"^0::/(.*)", groups, re.MULTILINE))
    for folder in (own, *own.parents):
        with suppress(OSError):
            given = (folder / "cgroup.subtree_control").read_text("ascii").split()
            if {"memory", "pids"} <= {*given} and os.access(folder, os.W_OK):
                return str(folder)
    return ""


def _remove(group: Path) -> None:
    """End all processes in a control group, and remove it."""
    until = time.monotonic() + _ENDING
    while time.monotonic() < until:
        with suppress(OSError):  # it needs Linux 5.14; the sandbox ends all as well
            (group / "cgroup.kill").write_text("1", "ascii")
        with suppress(OSError):
            group.rmdir()
            return
        time.sleep(_ENDING / 100)


def _trial(machine: Machine) -> str:
    """Return why these means fail, an empty text if they do not."""
    from quadctl.cli.lab import sandbox

    realm = Realm(f"lab-{os.getpid()}-trial")
    with (
        tempfile.TemporaryDirectory(prefix="quadctl-lab-") as made,
        socket.socket(socket.AF_UNIX) as hub,
        machine.control_group(Limits()) as group,
    ):
        folder, root = Path(made, "handin"), Path(made, "root")
        for each in (folder, root):
            each.mkdir(mode=0o700)
        command = [sys.executable, "-c", _LEAVES_A_CHILD]
        realm.create()
        try:
            hub.bind(str(realm.socket))
            done = subprocess.run(
                machine.shut_in(command, folder, realm.folder, root, Limits(), group),
                capture_output=True,
                text=True,
                timeout=_TRIAL,
                check=False,
            )
        finally:
            realm.remove()
    *_, last = ("", *done.stderr.splitlines())
    return "" if done.returncode == 0 else last.removeprefix(sandbox.REFUSED) or "it ended"
