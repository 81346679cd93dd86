"""Sandbox of one process of a hand-in: namespaces, Landlock, a user of its own, and limits.

    python -I -S sandbox.py SPEC COMMAND ...

It sees the interpreter and a copy of its folder, and of the run only the hub's socket. Without namespaces the
rest is there too, and as much of it is refused as Landlock and another user can refuse. It runs by
itself, on the standard library alone: so it starts in 20 ms, and nothing of ours is loaded in it.

Over 500 lines: it may import no other module of ours.
"""

import ctypes
import json
import os
import resource
import shutil
import signal
import stat
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NoReturn

_LIBC: Any = ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None

_NEWNS, _NEWIPC, _NEWUTS = 0x20000, 0x8000000, 0x4000000
_NEWUSER, _NEWPID, _NEWNET = 0x10000000, 0x20000000, 0x40000000
_BIND, _REC, _PRIVATE, _RDONLY, _NOSUID, _NODEV = 0x1000, 0x4000, 0x40000, 0x1, 0x2, 0x4
_DETACH = 2
_AT_FDCWD, _AT_RECURSIVE, _MOUNT_SETATTR = -100, 0x8000, 442
_READ_ONLY = _RDONLY | _NOSUID | _NODEV
_LANDLOCK = (444, 445, 446)
_LIST, _READ, _ALL = 0b1000, 0b1101, 0xFFFF  # list a folder; also run and read its files; anything
_OF_A_FILE = 0b1100000000000111  # run, write, read, truncate, control a device
_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER, _PR_SET_NO_NEW_PRIVS = 1, 36, 38
_CAPABILITIES = 0x20080522
"""Version of the kernel's structure of capabilities."""
REFUSED = "no sandbox: "
"""Beginning of the message if there can be none."""
_NOBODY = 65534
_STRANGERS = 0x70000000
"""First of the users that no system hands out (systemd, "Users, Groups, UIDs and GIDs")."""
_MEGABYTE = 1 << 20
_LOOK = 0.1
"""Seconds between two looks at the memory of all its processes."""
_SOON = 0.002
"""Seconds between two looks for the hub's socket."""
_DEVICES = ("null", "zero", "full", "random", "urandom")
_SYSTEM = ("usr", "bin", "sbin", "lib", "lib32", "lib64", "etc/ld.so.cache", "etc/alternatives")
"""Folders and files of the system, below the root, for a program to start."""
_VARIABLES = (
    "QUADCTL_REALM", "QUADCTL_VEHICLES", "QUADCTL_VEHICLE", "QUADCTL_NODE", "QUADCTL_RESTARTS",
    "QUADCTL_SUPERVISED", "QUADCTL_LEASH", "PYTHONUNBUFFERED",
)  # fmt: skip
"""Environment variables that it inherits: of those that its supervisor sets, the ones about the node."""


def main(spec: dict[str, Any], command: list[str]) -> int:
    """Run the command in a sandbox, and return its exit code.

    `spec`: means of the machine, `namespaces`, `user` and the version of `landlock`; a control `group` with the
    limits, or an empty text; `folder` with the hand-in, `root` an empty folder in one of the grader, `realm` of the
    run, folders that are `shown`, `hidden` and, for Python's import, `listed`; the search `path`; limits `memory` and
    `disk` in MB, `seconds` of CPU time, `processes`; `killed`, the beginning of the line on a limit that has ended it.
    """
    group = os.open(spec["group"], os.O_RDONLY) if spec["group"] else None
    user = _stranger() if spec["user"] else os.getuid()
    proc = os.open("/proc", os.O_RDONLY)
    enter = _enter_namespaces if spec["namespaces"] else _enter_folder
    base = enter(Path(spec["root"]), spec, user)
    rules = list(_rules(base, spec)) if spec["landlock"] else []
    others = 0 if spec["namespaces"] or spec["user"] else _threads(proc, user)
    child = os.fork()
    if child == 0:
        if group is not None:
            _join(group)
        _become(spec, command, user, base, rules, spec["processes"] + others)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda number, _frame: os.kill(child, number))
    try:
        if group is not None:
            return _wait(child, group, spec)
        if spec["namespaces"]:
            return _watch(child, proc, _in_namespace_of(child, proc), spec)
        return _watch(child, proc, lambda: _descendants(proc), spec)
    finally:
        if not spec["namespaces"]:
            _end_descendants(proc)


def landlock() -> int:
    """Return the version of the kernel's Landlock, 0 if it has none."""
    return max(int(_LIBC.syscall(_LANDLOCK[0], None, 0, 1)), 0)


def adopt_orphans() -> None:
    """Become the parent of every descendant that loses its own."""
    _call("subreaper", _LIBC.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0))


def end_descendants() -> None:
    """Kill all descendants of this process, which has adopted its orphans."""
    _end_descendants(os.open("/proc", os.O_RDONLY))


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


def _enter_namespaces(root: Path, spec: dict[str, Any], user: int) -> Path:
    """Enter a new root with what it may see; return it. The next child is the first process there."""
    top = _separate(root)
    room = spec["disk"] * _MEGABYTE + _size(Path(spec["folder"]))
    _mount("tmpfs", root, "tmpfs", _NOSUID | _NODEV, f"size={room},mode=755")
    # An inner folder is there with its outer one.
    for path in sorted(_seen(spec)):
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
    (root / "proc").mkdir(exist_ok=True)
    _furnish(root, spec, user)
    # The present root must be a mount point, which the root of a chroot need not be.
    new = os.open(root, os.O_PATH)
    _change_root(top)
    os.fchdir(new)
    _call("pivot_root", _LIBC.pivot_root(b".", b"."))
    _call("umount", _LIBC.umount2(b".", _DETACH))
    return Path("/")


def _size(folder: Path) -> int:
    """Return the bytes that a copy of a folder takes, at least a page for each file."""
    sizes = (path.lstat().st_size for path in folder.rglob("*"))
    return sum(size + resource.getpagesize() for size in sizes)


def _separate(root: Path) -> int:
    """Enter namespaces of our own, by right or as a new user; return the root of all their mounts.

    No mount in them is seen outside.
    """
    user, group = os.getuid(), os.getgid()
    own = _NEWNS | _NEWPID | _NEWNET | _NEWIPC | _NEWUTS
    if _LIBC.unshare(own) < 0:
        _call("no namespaces", _LIBC.unshare(own | _NEWUSER))
        Path("/proc/self/setgroups").write_text("deny", encoding="ascii")
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1", encoding="ascii")
        Path("/proc/self/gid_map").write_text(f"{group} {group} 1", encoding="ascii")
    # In a chroot the mounts above our root are out of reach, and may be shared with the host. A
    # process is held by its root only while it is below: so we move that aside, go up, and come back.
    here = os.open("/", os.O_PATH)
    os.chdir("/")
    os.chroot(root)
    while not os.path.samefile(".", ".."):  # noqa: PTH121 - Path(".") has no parent
        os.chdir("..")
    os.chroot(".")
    top = os.open("/", os.O_PATH)
    _mount("none", "/", "", _REC | _PRIVATE)
    _change_root(here)
    return top


def _change_root(folder: int) -> None:
    os.fchdir(folder)
    os.chroot(".")


def _enter_folder(root: Path, spec: dict[str, Any], user: int) -> Path:
    """Make a folder with all that is its own, and return it."""
    adopt_orphans()
    base = root / str(os.getpid())
    base.mkdir(mode=0o700)
    _furnish(base, spec, user)
    if spec["user"]:
        os.chown(base, user, -1)
        for path in (root, root.parent):
            path.chmod(0o711)
    return base


def _furnish(base: Path, spec: dict[str, Any], user: int) -> None:
    """Add a copy of the hand-in, a folder for temporary files, and its part of the run."""
    for name in ("tmp", "handin"):
        (base / name).mkdir(exist_ok=True)
    (base / "tmp").chmod(0o1777)
    shutil.copytree(spec["folder"], base / "handin", dirs_exist_ok=True, symlinks=True)
    _copy_realm(Path(spec["realm"]), base / "run/quadctl" / Path(spec["realm"]).name, spec)
    for path in (base / "handin", base / "run/quadctl"):
        for inner in (path, *path.rglob("*")):
            if not inner.is_socket():
                os.chown(inner, user, -1, follow_symlinks=False)


def _seen(spec: dict[str, Any]) -> set[str]:
    """Return the real paths of all that is shown."""
    shown = [f"/{name}" for name in _SYSTEM] + list(spec["shown"])
    return {os.path.realpath(each) for each in shown if os.path.exists(each)}  # noqa: PTH110


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


def _copy_realm(realm: Path, own: Path, spec: dict[str, Any]) -> None:
    """Copy the run's parameters and the node's address, and show its hub's socket."""
    own.mkdir(parents=True, mode=0o700)
    seen = Path("/", own.relative_to(spec["root"])) if spec["namespaces"] else own
    socket, shown = realm / "hub.sock", own / "hub.sock"
    for address in realm.glob("*.hub.json"):
        text = address.read_text("utf-8")
        (own / address.name).write_text(text.replace(f"{realm}/", f"{seen}/"), "utf-8")
        # The hub starts at the same time, and a socket that it makes later is not shown here any more.
        while f"{socket}" in text and not socket.exists():
            time.sleep(_SOON)
    if (realm / "params").is_dir():
        shutil.copytree(realm / "params", own / "params")
    if not socket.exists():
        return
    if spec["namespaces"]:
        shown.touch()
        _mount(str(socket), shown, "", _BIND)
    elif spec["user"]:
        shown.hardlink_to(socket)  # another user cannot follow a link into the realm
    else:
        shown.symlink_to(socket)
    if spec["user"]:
        socket.chmod(0o666)  # its folder lets nobody else in


def _become(
    spec: dict[str, Any], command: list[str], user: int, base: Path,
    rules: list[tuple[str, int]], threads: int,
) -> NoReturn:  # fmt: skip
    """Be the command, as this user, within the limits."""
    try:
        os.nice(5)
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        os.setsid()
        if spec["namespaces"]:
            # A container may forbid it; programs can do without.
            _LIBC.mount(b"proc", b"/proc", b"proc", _READ_ONLY, None)
        environment = {name: os.environ[name] for name in _VARIABLES if name in os.environ}
        environment |= {
            "PATH": spec["path"],
            "LANG": "C.UTF-8",
            # NumPy and SciPy each start a thread for each processor of a server: more than the limit.
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "HOME": f"{base / 'handin'}",
            "TMPDIR": f"{base / 'tmp'}",
            "XDG_RUNTIME_DIR": f"{base / 'run'}",
        }
        os.chdir(base / "handin")
        if spec["user"]:
            os.setgroups([])
            os.setresgid(_NOBODY, _NOBODY, _NOBODY)
            os.setresuid(user, user, user)
            _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)  # a new user has cleared it
        for limit, most in (
            (resource.RLIMIT_CPU, spec["seconds"]),
            (resource.RLIMIT_NPROC, threads),
            (resource.RLIMIT_FSIZE, spec["disk"] * _MEGABYTE),
            (resource.RLIMIT_NOFILE, 256),
            (resource.RLIMIT_CORE, 0),
        ):
            _, highest = resource.getrlimit(limit)
            value = most if highest == resource.RLIM_INFINITY else min(most, highest)
            resource.setrlimit(limit, (value, value))
        _LIBC.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
        _drop_capabilities()
        if rules:
            _restrict(spec["landlock"], rules)
        _run(command, environment)
    except OSError as error:
        print(f"{command[0]}: {error}", file=sys.stderr)
    os._exit(127)


def _run(command: list[str], environment: dict[str, str]) -> None:
    """Become a hand-in's own command; print an error if there is no such program."""
    try:
        os.execvpe(command[0], command, environment)  # noqa: S606 - see above
    except (FileNotFoundError, PermissionError):
        print(f"{command[0]} was not found, or is not executable", file=sys.stderr)


def _drop_capabilities() -> None:
    """Give up all capabilities; without new privileges even root gets none back."""
    header, none = (ctypes.c_uint32 * 2)(_CAPABILITIES, 0), (ctypes.c_uint32 * 6)()
    _call("capset", _LIBC.capset(ctypes.byref(header), ctypes.byref(none)))


def _rules(base: Path, spec: dict[str, Any]) -> Iterator[tuple[str, int]]:
    """Yield what Landlock is to allow below which paths."""
    if spec["namespaces"]:
        yield "/", _READ
        yield from (("/dev", _ALL), ("/proc", _ALL))
    else:
        hidden = [os.path.realpath(each) for each in spec["hidden"]]
        for path in _seen(spec):
            yield from _beside(path, hidden)
        yield from ((path, _LIST) for path in spec["listed"])
        devices = (f"/dev/{name}" for name in _DEVICES)
        yield from ((path, _ALL) for path in devices if os.path.exists(path))  # noqa: PTH110
    yield from ((str(base / name), _ALL) for name in ("handin", "tmp", "run"))


def _beside(path: str, hidden: list[str]) -> Iterator[tuple[str, int]]:
    """Yield a rule to read a path, or if something is hidden below it, rules for the rest of it.

    Landlock only allows. The names of what is hidden can be listed: Python's import lists folders.
    """
    if not any(f"{each}/".startswith(f"{path}/") for each in hidden):
        yield path, _READ
    elif path not in hidden:
        yield path, _LIST
        with os.scandir(path) as entries:
            for entry in entries:
                if not entry.is_symlink():
                    yield from _beside(entry.path, hidden)


def _restrict(version: int, rules: Iterable[tuple[str, int]]) -> None:
    """Let Landlock refuse the files that no rule allows, TCP, and signals to others."""
    create, add, enforce = _LANDLOCK
    known = (1 << min(13 + (version >= 2) + (version >= 3) + (version >= 5), 16)) - 1
    # Files; TCP (all of it refused, from version 4); abstract sockets and signals (version 6).
    handled = (ctypes.c_uint64 * 3)(known, 3 if version >= 4 else 0, 3 if version >= 6 else 0)
    size = 8 if version < 4 else 16 if version < 6 else 24
    ruleset = _LIBC.syscall(create, ctypes.byref(handled), size, 0)
    _call("landlock", ruleset)
    for path, wanted in rules:
        opened = os.open(path, os.O_PATH)
        is_folder = stat.S_ISDIR(os.fstat(opened).st_mode)
        allowed = wanted & known & (_ALL if is_folder else _OF_A_FILE)
        rule = allowed.to_bytes(8, sys.byteorder) + opened.to_bytes(4, sys.byteorder)
        _call("landlock", _LIBC.syscall(add, ruleset, 1, rule, 0))
        os.close(opened)
    _call("landlock", _LIBC.syscall(enforce, ruleset, 0))
    os.close(ruleset)


def _join(group: int) -> None:
    """Enter a control group."""
    file = os.open("cgroup.procs", os.O_WRONLY, dir_fd=group)
    os.write(file, b"0")
    os.close(file)


def _wait(child: int, group: int, spec: dict[str, Any]) -> int:
    """Wait for the command's end; the kernel ends all in the group if they take too much memory."""
    before = _killed(group)
    while True:
        ended, status, used = os.wait4(-1, 0)
        if ended == child:
            break
    if _killed(group) == before:
        return _exit_code(status, used, spec)
    return _ended(f"{spec['memory']} MB of memory", spec)


def _killed(group: int) -> bytes:
    """Return the count of processes that the kernel has killed for their memory."""
    words = _read(group, "memory.events").split()
    return words[words.index(b"oom_kill") + 1]


def _watch(child: int, proc: int, members: Callable[[], list[int]], spec: dict[str, Any]) -> int:
    """Wait for the command's end, and end it if it and its processes are too large or too many."""
    while True:
        ended, status, used = os.wait4(-1, os.WNOHANG)
        if ended == child:
            return _exit_code(status, used, spec)
        if ended:
            continue
        pids = members()
        too_much = ""
        if _memory(proc, pids, spec) > spec["memory"] * _MEGABYTE:
            too_much = f"{spec['memory']} MB of memory"
        elif len(pids) > spec["processes"]:
            too_much = f"{spec['processes']} processes"
        if too_much:
            os.kill(child, signal.SIGKILL)
            return _ended(too_much, spec)
        time.sleep(_LOOK)


def _exit_code(status: int, used: resource.struct_rusage, spec: dict[str, Any]) -> int:
    """Return the exit code of a command; print the limit if the kernel has ended it for its time."""
    code, seconds = os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime
    # For its limit the kernel counts ticks, which on a busy machine differ from the time used.
    if code == -signal.SIGKILL and seconds > spec["seconds"] / 2:
        return _ended(f"{spec['seconds']} s of processor time", spec)
    return code % 256


def _ended(limit: str, spec: dict[str, Any]) -> int:
    os.write(2, f"{spec['killed']}{limit}\n".encode())
    return 128 + signal.SIGKILL


def _in_namespace_of(child: int, proc: int) -> Callable[[], list[int]]:
    """Return a function that lists the processes in the pid namespace of a child."""
    own = os.stat(f"{child}/ns/pid", dir_fd=proc).st_ino

    def is_in(pid: int) -> bool:
        try:
            return os.stat(f"{pid}/ns/pid", dir_fd=proc).st_ino == own
        except OSError:
            return False  # it has ended, or is not ours

    return lambda: [pid for pid in _pids(proc) if is_in(pid)]


def _descendants(proc: int) -> list[int]:
    """Return all descendants of this process."""
    parents = {pid: int(fields[1]) for pid in _pids(proc) if (fields := _stat(proc, pid))}
    found, new = list[int](), {os.getpid()}
    while new := {pid for pid, parent in parents.items() if parent in new}:
        found += new
    return found


def _end_descendants(proc: int) -> None:
    """Kill all descendants, also those started meanwhile: the orphans among them are our children."""
    while True:
        for pid in _descendants(proc):
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        try:
            os.waitpid(-1, 0)
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return


def _threads(proc: int, user: int) -> int:
    """Return how many threads a user has."""
    found = 0
    for pid in _pids(proc):
        try:
            if os.stat(str(pid), dir_fd=proc).st_uid == user and (fields := _stat(proc, pid)):
                found += int(fields[17])
        except OSError:
            continue  # it has ended
    return found


def _pids(proc: int) -> list[int]:
    return [int(name) for name in os.listdir(proc) if name.isdigit()]


def _stat(proc: int, pid: int) -> list[bytes]:
    """Return the fields of a process, from its state on; none if it has ended."""
    # A name may contain blanks and brackets.
    return _read(proc, f"{pid}/stat").rpartition(b")")[2].split()


def _memory(proc: int, pids: Iterable[int], spec: dict[str, Any]) -> int:
    """Return the bytes of processes in memory, and of the files without a name that they hold there."""
    total, files = 0, dict[tuple[int, int], int]()
    for pid in pids:
        fields = _read(proc, f"{pid}/statm").split()
        total += int(fields[1]) * resource.getpagesize() if fields else 0
        for path, size in (*_opened(proc, pid), *_mapped(proc, pid)):
            try:
                status = os.stat(path, dir_fd=proc)
            except FileNotFoundError:
                continue  # it is closed, or the process has ended
            except PermissionError:
                total += size
                continue
            if stat.S_ISREG(status.st_mode) and not status.st_nlink:
                files[status.st_dev, status.st_ino] = 512 * status.st_blocks
    if spec["namespaces"]:
        segments = _read(proc, "sysvipc/shm").splitlines()[1:]
        total += sum(int(line.split()[14]) for line in segments)
    return total + sum(files.values())


def _opened(proc: int, pid: int) -> list[tuple[str, int]]:
    """Return the open files of a process, none if it has ended or hides them."""
    try:
        folder = os.open(f"{pid}/fd", os.O_RDONLY, dir_fd=proc)
    except OSError:
        return []
    try:
        return [(f"{pid}/fd/{name}", 0) for name in os.listdir(folder)]  # noqa: PTH208 - a descriptor
    finally:
        os.close(folder)


def _mapped(proc: int, pid: int) -> Iterator[tuple[str, int]]:
    """Yield the mapped files of a process that have no name any more, each with the bytes mapped."""
    for line in _read(proc, f"{pid}/maps").splitlines():
        if line.endswith(b"(deleted)"):
            begin, end = (int(each, 16) for each in line.split(maxsplit=1)[0].split(b"-"))
            yield f"{pid}/map_files/{begin:x}-{end:x}", end - begin


def _read(proc: int, name: str) -> bytes:
    try:
        with os.fdopen(os.open(name, os.O_RDONLY, dir_fd=proc), "rb") as file:
            return file.read()
    except OSError:
        return b""  # it has ended


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
