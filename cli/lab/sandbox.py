"""Sandbox of one process of a hand-in: namespaces, Landlock, and limits.

    python -I -S sandbox.py SPEC COMMAND ...

It sees the interpreter and a copy of its folder, and of the run only the hub's socket. It runs by
itself, on the standard library alone: so it starts in 20 ms, and nothing of ours is loaded in it.
"""

import ctypes
import json
import os
import resource
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

_LIBC: Any = ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None

_NEWNS, _NEWIPC, _NEWUTS = 0x20000, 0x8000000, 0x4000000
_NEWUSER, _NEWPID, _NEWNET = 0x10000000, 0x20000000, 0x40000000
_BIND, _REC, _PRIVATE, _NOSUID, _NODEV = 0x1000, 0x4000, 0x40000, 0x2, 0x4
_DETACH = 2
_AT_FDCWD, _AT_RECURSIVE, _MOUNT_SETATTR = -100, 0x8000, 442
_READ_ONLY = 0x1 | 0x2 | 0x4  # and no set-uid programs, no devices
_LANDLOCK = (444, 445, 446)
_PR_SET_PDEATHSIG, _PR_SET_NO_NEW_PRIVS = 1, 38
REFUSED = "no sandbox: "
"""Beginning of the message if there can be none."""
_NOBODY = 65534
_STRANGERS = 0x70000000
"""First of the users that no system hands out (systemd, "Users, Groups, UIDs and GIDs")."""
_MEGABYTE = 1 << 20
_LOOK = 0.1
"""Seconds between two looks at the memory of all its processes."""
_DEVICES = ("null", "zero", "full", "random", "urandom")
_SYSTEM = ("usr", "bin", "sbin", "lib", "lib32", "lib64", "etc/ld.so.cache", "etc/alternatives")
"""Folders and files of the system, below the root, for a program to start."""
_VARIABLES = ("QUADCTL_", "PATH", "PYTHONUNBUFFERED", "LANG", "LC_")
"""Prefixes of environment variables that it inherits."""


def main(spec: dict[str, Any], command: list[str]) -> int:
    """Run the command in a sandbox, and return its exit code.

    `spec`: `folder` with the hand-in, `root` an empty folder, `realm` of the run, `shown` and
    `hidden` folders; limits `memory` and `disk` in MB, `seconds` of CPU time, `processes`.
    """
    os.nice(5)
    as_root = os.getuid() == 0
    user = _stranger() if as_root else os.getuid()
    proc = os.open("/proc", os.O_RDONLY)
    _separate(as_root=as_root)
    _build(Path(spec["root"]), spec, user)
    child = os.fork()
    if child == 0:
        _become(spec, command, user)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda number, _frame: os.kill(child, number))
    return _watch(child, proc, spec["memory"] * _MEGABYTE)


def _stranger() -> int:
    """Return a user for this sandbox alone: the kernel counts processes by user, not by sandbox.

    A container with too few users has only nobody: its sandboxes share one limit.
    """
    user = _STRANGERS + os.getpid()
    for line in Path("/proc/self/uid_map").read_text("ascii").splitlines():
        first, _outside, count = map(int, line.split())
        if first <= user < first + count:
            return user
    return _NOBODY


def _separate(*, as_root: bool) -> None:
    """Enter namespaces of our own; the next child is the first process of its own."""
    user, group = os.getuid(), os.getgid()
    own = _NEWNS | _NEWPID | _NEWNET | _NEWIPC | _NEWUTS | (0 if as_root else _NEWUSER)
    _call("namespaces of its own", _LIBC.unshare(own))
    if not as_root:
        Path("/proc/self/setgroups").write_text("deny", encoding="ascii")
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1", encoding="ascii")
        Path("/proc/self/gid_map").write_text(f"{group} {group} 1", encoding="ascii")
    _mount("none", "/", "", _REC | _PRIVATE)


def _build(root: Path, spec: dict[str, Any], owner: int) -> None:
    """Make a new root with what it may see, and enter it."""
    _mount("tmpfs", root, "tmpfs", _NOSUID | _NODEV, f"size={spec['disk']}m,mode=755")
    shown = [f"/{name}" for name in _SYSTEM] + list(spec["shown"])
    # An inner folder is there with its outer one.
    for path in sorted({os.path.realpath(each) for each in shown if os.path.exists(each)}):  # noqa: PTH110
        _show(path, root)
    for name in _SYSTEM:
        link = Path("/", name)
        if link.is_symlink() and not (root / name).exists():
            (root / name).symlink_to(link.readlink())
    for path in spec["shown"]:
        if Path(path).is_symlink():
            _link(Path(path), root)
    for path in map(os.path.realpath, spec["hidden"]):
        if (root / path.lstrip("/")).is_dir():
            _mount("tmpfs", root / path.lstrip("/"), "tmpfs", _NOSUID | _NODEV, "size=4k,mode=755")
    (root / "dev").mkdir()
    for name in _DEVICES:
        (root / "dev" / name).touch()
        _mount(f"/dev/{name}", root / "dev" / name, "", _BIND)
    for name in ("proc", "tmp", "handin"):
        (root / name).mkdir(exist_ok=True)
    (root / "tmp").chmod(0o1777)
    shutil.copytree(spec["folder"], root / "handin", dirs_exist_ok=True, symlinks=True)
    _copy_realm(Path(spec["realm"]), root / "run/quadctl" / Path(spec["realm"]).name)
    for path in (root / "handin", root / "run/quadctl"):
        for inner in (path, *path.rglob("*")):
            if not inner.is_socket():
                os.chown(inner, owner, -1, follow_symlinks=False)
    os.chdir(root)
    _call("pivot_root", _LIBC.pivot_root(b".", b"."))
    _call("umount", _LIBC.umount2(b".", _DETACH))
    os.chdir("/handin")


def _show(path: str, root: Path) -> None:
    target = root / path.lstrip("/")
    if target.exists():
        return
    if Path(path).is_dir():
        target.mkdir(parents=True)
    else:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.touch()
    _mount(path, target, "", _BIND | _REC)
    attributes = (ctypes.c_uint64 * 4)(_READ_ONLY, 0, 0, 0)
    _call(
        "mount_setattr",
        _LIBC.syscall(
            _MOUNT_SETATTR, _AT_FDCWD, os.fsencode(target), _AT_RECURSIVE,
            ctypes.byref(attributes), ctypes.sizeof(attributes),
        ),
    )  # fmt: skip


def _link(path: Path, root: Path) -> None:
    own = root / str(path)[1:]
    own.parent.mkdir(parents=True, exist_ok=True)
    if not own.exists() and not own.is_symlink():
        own.symlink_to(os.path.realpath(path))


def _copy_realm(realm: Path, own: Path) -> None:
    """Copy the run's parameters, and show its hub's socket."""
    own.mkdir(parents=True, mode=0o700)
    if (realm / "params").is_dir():
        shutil.copytree(realm / "params", own / "params")
    if (realm / "hub.sock").exists():
        (own / "hub.sock").touch()
        _mount(str(realm / "hub.sock"), own / "hub.sock", "", _BIND)
        if os.getuid() == 0:
            (realm / "hub.sock").chmod(0o666)  # its folder lets nobody else in


def _become(spec: dict[str, Any], command: list[str], user: int) -> NoReturn:
    """Be the command, as this user, within the limits."""
    try:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        os.setsid()
        # A container may forbid it; programs can do without.
        _LIBC.mount(b"proc", b"/proc", b"proc", _NOSUID | _NODEV, None)
        environment = {k: v for k, v in os.environ.items() if k.startswith(_VARIABLES)}
        environment |= {"HOME": "/handin", "TMPDIR": "/tmp", "XDG_RUNTIME_DIR": "/run"}  # noqa: S108
        if user != os.getuid():
            os.setgroups([])
            os.setresgid(_NOBODY, _NOBODY, _NOBODY)
            os.setresuid(user, user, user)
            _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)  # a new user has cleared it
        for limit, most in (
            (resource.RLIMIT_CPU, spec["seconds"]),
            (resource.RLIMIT_NPROC, spec["processes"]),
            (resource.RLIMIT_FSIZE, spec["disk"] * _MEGABYTE),
            (resource.RLIMIT_NOFILE, 256),
            (resource.RLIMIT_CORE, 0),
        ):
            resource.setrlimit(limit, (most, most))
        _LIBC.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
        _restrict(("/handin", "/tmp", "/run", "/dev", "/proc"))  # noqa: S108
        os.execvpe(command[0], command, environment)  # noqa: S606 - a hand-in's own command
    except OSError as error:
        print(f"{command[0]}: {error}", file=sys.stderr)
    os._exit(127)


def _restrict(writable: tuple[str, ...]) -> None:
    """Let Landlock, if the kernel has it, refuse writing outside these folders, and foreign signals."""
    create, add, enforce = _LANDLOCK
    version = _LIBC.syscall(create, None, 0, 1)
    if version < 1:
        return
    known = (1 << min(13 + (version >= 2) + (version >= 3) + (version >= 5), 16)) - 1
    reading = 0b1101  # run, read a file, list a folder
    # Files; TCP (all of it refused, from version 4); abstract sockets and signals (version 6).
    handled = (ctypes.c_uint64 * 3)(known, 3 if version >= 4 else 0, 3 if version >= 6 else 0)
    size = 8 if version < 4 else 16 if version < 6 else 24
    rules = _LIBC.syscall(create, ctypes.byref(handled), size, 0)
    if rules < 0:
        return
    for path, allowed in (("/", reading), *((path, known) for path in writable)):
        folder = os.open(path, os.O_PATH)
        rule = allowed.to_bytes(8, sys.byteorder) + folder.to_bytes(4, sys.byteorder)
        _call("landlock", _LIBC.syscall(add, rules, 1, rule, 0))
        os.close(folder)
    _call("landlock", _LIBC.syscall(enforce, rules, 0))
    os.close(rules)


def _watch(child: int, proc: int, memory: int) -> int:
    """Wait for the command's end, and end it if all of its processes have more than so many bytes."""
    own = os.stat(f"{child}/ns/pid", dir_fd=proc)
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status) % 256
        if sum(_resident(proc, own.st_ino)) > memory:
            os.write(2, f"ended: more than {memory // _MEGABYTE} MB of memory\n".encode())
            os.kill(child, signal.SIGKILL)
            return 128 + signal.SIGKILL
        time.sleep(_LOOK)


def _resident(proc: int, namespace: int) -> Iterator[int]:
    """Yield the bytes in memory of each process in a pid namespace."""
    for name in os.listdir(proc):
        if not name.isdigit():
            continue
        try:
            if os.stat(f"{name}/ns/pid", dir_fd=proc).st_ino != namespace:
                continue
            file = os.open(f"{name}/statm", os.O_RDONLY, dir_fd=proc)
            with os.fdopen(file, "rb") as statm:
                yield int(statm.read().split()[1]) * resource.getpagesize()
        except OSError:
            continue  # it has ended, or is not ours


def _mount(source: Any, target: Any, kind: str, flags: int, options: str = "") -> None:
    words = (os.fsencode(each) or None for each in (source, target, kind))
    _call(f"mount {target}", _LIBC.mount(*words, flags, os.fsencode(options) or None))


def _call(what: str, result: int) -> None:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")


if __name__ == "__main__":
    try:
        code = main(json.loads(sys.argv[1]), sys.argv[2:])
    except OSError as problem:
        print(f"{REFUSED}{problem.strerror or problem}", file=sys.stderr)
        code = 126
    os._exit(code)
