"""Sandbox of a hand-in's node, by the means that a machine may have."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from quadctl.cli.lab import sandbox
from quadctl.cli.lab.machine import Limits, Machine, probe
from tests.support.handins import write
from tests.support.lab import Lab
from tests.support.namespaces import tool
from tests.support.poor_machines import chroot, poor
from tests.support.running import alive

LANDLOCK = sandbox.landlock()
OPEN = Machine(landlock=LANDLOCK)
"""This machine, were it without namespaces."""
LIMITS = Limits()


@pytest.fixture(scope="module")
def complete() -> Machine:
    """This machine with all that it has."""
    return probe()


def shut_in(
    lab: Lab,
    machine: Machine,
    *command: str,
    limits: Limits = LIMITS,
    files: str = "",
    group: str = "",
) -> list[str]:
    """Return the words that run a command in a sandbox, with one file `own` in its folder."""
    folder, root, realm = (lab.folder / name for name in ("own/handin", "own/root", "own/realm"))
    for path in (folder, root, realm):
        path.mkdir(parents=True, mode=0o700)
    (folder / "own").write_text(files, "utf-8")
    return machine.shut_in(list(command), folder, realm, root, limits, group)


READS = """
import os, resource, socket, sys
def tried(do, *words):
    try:
        do(*words)
        return "yes"
    except OSError as error:
        return type(error).__name__
print(open("own").read(), tried(open, "own", "w"), tried(open, os.environ["TMPDIR"] + "/x", "w"))
print(tried(open, sys.argv[1]), tried(os.listdir, os.path.dirname(sys.argv[1])))
try:
    import quadctl.cli.lab.lab
    print("solution")
except ImportError as error:
    print(type(error).__name__)
except PermissionError:
    print("PermissionError")
print(tried(socket.create_connection, ("127.0.0.1", int(sys.argv[2]))))
print(resource.getrlimit(resource.RLIMIT_CORE)[1], bool(os.environ.get("SECRET")))
"""


@pytest.mark.parametrize("version", sorted({0, LANDLOCK}))
def test_without_namespaces_a_node_has_what_landlock_leaves(lab: Lab, version: int):
    secret = lab.file("mine", "secret")
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
        words = [sys.executable, "-c", READS, str(secret), port]
        command = shut_in(lab, Machine(landlock=version), *words, files="hello")
        done = lab.run(command, SECRET="1")
    files, network = version < 1, version < 4
    assert done.out.splitlines() == [
        "hello yes yes",
        "yes yes" if files else "PermissionError PermissionError",
        "solution" if files else "PermissionError",
        "yes" if network else "PermissionError",
        "0 False",
    ], done.err


@pytest.mark.needs("sandbox")
def test_in_namespaces_a_node_has_its_own_files_and_no_network(lab: Lab, complete: Machine):
    secret = lab.file("mine", "secret")
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
        words = [sys.executable, "-c", READS, str(secret), port]
        done = lab.run(shut_in(lab, complete, *words, files="hello"), SECRET="1")
    assert done.out.splitlines() == [
        "hello yes yes",
        "FileNotFoundError FileNotFoundError",
        "ModuleNotFoundError",
        "PermissionError" if LANDLOCK >= 4 else "OSError",
        "0 False",
    ], done.err


WAITS = "import sys; print('in', flush=True); sys.stdin.read()"


@pytest.mark.needs("ip", "sandbox", "mounts")
@pytest.mark.parametrize("where", ["machine", "chroot"])
def test_no_mount_of_a_sandbox_is_seen_outside(lab: Lab, complete: Machine, where: str):
    script = "mount --make-rshared /" if where == "machine" else chroot(lab.folder / "new")
    inside = shut_in(lab, complete, sys.executable, "-c", WAITS)
    with subprocess.Popen(
        [*poor(script), "sh", "-c", '"$@"; true', "sh", *inside],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=lab.folder,
    ) as outside:
        assert outside.stdout is not None
        assert outside.stdout.readline() == "in\n"
        mounts = mounts_of(outside.pid)
        outside.communicate("")
    assert outside.returncode == 0
    assert "shared:" in mounts
    assert str(lab.folder / "own") not in mounts


def mounts_of(pid: int) -> str:
    """Return all mounts in the namespace of a process, also those that its root hides."""
    as_user = [] if os.geteuid() == 0 else ["--user", "--preserve-credentials"]
    enter = [tool("nsenter"), f"--target={pid}", *as_user, "--mount"]
    return subprocess.run(
        [*enter, "cat", "/proc/self/mountinfo"], capture_output=True, text=True, check=True
    ).stdout


PROBES = """
from quadctl.cli.lab.machine import probe
print(probe())
"""


@pytest.mark.thorough
@pytest.mark.needs("ip", "mounts")
def test_a_machine_that_forbids_namespaces_is_found_out(lab: Lab):
    """As root in a container: in a chroot nobody gets a new user, and without this right no other one."""
    without_right = [tool("setpriv"), "--bounding-set=-sys_admin"]
    enter = [*poor(chroot(lab.folder / "new")), *without_right]
    words = "from quadctl.cli.lab.machine import probe; print((found := probe()).namespaces, found.lacks)"
    done = lab.run([*enter, sys.executable, "-c", words])
    assert (done.out.startswith("False no namespaces: "), done.err) == (True, ""), done.out


@pytest.mark.needs("ip", "sandbox", "mounts")
def test_a_chroot_shuts_a_node_in_as_completely(lab: Lab, complete: Machine):
    done = lab.run([*poor(chroot(lab.folder / "new")), sys.executable, "-c", PROBES])
    assert (done.out, done.err) == (f"{complete}\n", "")


def test_a_node_is_another_user_where_the_machine_has_more(lab: Lab, complete: Machine):
    words = 'id -u; cat "$0" && echo read; test -w "$XDG_RUNTIME_DIR"/quadctl/realm/hub.sock && echo hub'
    secret = lab.file("mine\n", "secret")
    secret.chmod(0o600)
    lab.folder.chmod(0o711)  # as /tmp, through which anybody may go
    command = shut_in(lab, Machine(user=complete.user), "sh", "-c", words, str(secret))
    with socket.socket(socket.AF_UNIX) as hub:
        hub.bind(str(lab.folder / "own/realm/hub.sock"))
        done = lab.run(command)
    user, *more = done.out.splitlines()
    assert (int(user) != os.getuid()) is complete.user
    assert more == (["hub"] if complete.user else ["mine", "read", "hub"]), done.err


SEES_A_HUB = 'test -S "$XDG_RUNTIME_DIR"/quadctl/realm/hub.sock && echo hub'


@pytest.mark.parametrize("namespaces", [True, False])
def test_a_node_starts_when_its_hub_has_its_socket(
    lab: Lab, complete: Machine, *, namespaces: bool
):
    machine = complete if namespaces else Machine(user=complete.user)
    lab.folder.chmod(0o711)  # as /tmp, through which anybody may go
    command = shut_in(lab, machine, "sh", "-c", SEES_A_HUB)
    path = lab.folder / "own/realm/hub.sock"
    (path.parent / "safety.hub.json").write_text(
        f'{{"endpoint":"unixsock-stream/{path}"}}', "utf-8"
    )
    with (
        socket.socket(socket.AF_UNIX) as hub,
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as node,
    ):
        with pytest.raises(subprocess.TimeoutExpired):
            node.wait(0.5)
        hub.bind(str(path))
        assert node.communicate()[0] == "hub\n"


EATS = """
import os, time
if os.fork() == 0:
    kept = b"x" * (200 << 20)
time.sleep(1000)
"""


FILLS_FILES = """
import mmap, os, sys, time
for number in range(10):
    file = os.memfd_create("x")
    os.write(file, b"x" * (30 << 20))
    if sys.argv[1] == "mapped":
        globals()[f"kept{number}"] = mmap.mmap(file, 4096)  # one page of many
        os.close(file)
time.sleep(1000)
"""
FILLS_SEGMENTS = """
import ctypes, time
libc = ctypes.CDLL(None)
libc.shmat.restype = ctypes.c_void_p
for _ in range(10):
    place = ctypes.c_void_p(libc.shmat(libc.shmget(0, 30 << 20, 0o1600), None, 0))
    ctypes.memset(place, 1, 30 << 20)
    libc.shmdt(place)
time.sleep(1000)
"""


@pytest.mark.parametrize(
    ("machine", "code", "word"),
    [
        (OPEN, EATS, ""),
        (OPEN, FILLS_FILES, "open"),
        pytest.param(None, EATS, "", marks=pytest.mark.needs("sandbox")),
        pytest.param(None, FILLS_FILES, "open", marks=pytest.mark.needs("sandbox")),
        pytest.param(None, FILLS_FILES, "mapped", marks=pytest.mark.needs("sandbox")),
        pytest.param(None, FILLS_SEGMENTS, "", marks=pytest.mark.needs("sandbox")),
    ],
)
def test_a_node_with_too_much_memory_is_ended(
    lab: Lab, machine: Machine | None, code: str, word: str, complete: Machine
):
    """Pages of its own, and those of files without a name and of segments, mapped or not.

    A machine with control groups leaves it to them.
    """
    limits, used = Limits(memory=100), machine or complete
    with used.control_group(limits) as group:
        words = [sys.executable, "-S", "-c", code, word]
        done = lab.run(shut_in(lab, used, *words, limits=limits, group=group), 60)
    assert (done.code, done.err) == (137, "killed by its limit: 100 MB of memory\n")
    assert not group or not Path(group).exists()


@pytest.mark.thorough
@pytest.mark.parametrize("machine", [OPEN, pytest.param(None, marks=pytest.mark.needs("sandbox"))])
def test_a_node_that_has_used_its_time_is_ended(
    lab: Lab, machine: Machine | None, complete: Machine
):
    words = [sys.executable, "-S", "-c", "while True: pass"]
    done = lab.run(shut_in(lab, machine or complete, *words, limits=Limits(seconds=1)), 60)
    assert (done.code, done.err) == (137, "killed by its limit: 1 s of processor time\n")


WRITES = """
for name in "abc":
    open(name, "wb").write(bytes(1 << 19))
    print(name)
"""


@pytest.mark.needs("sandbox")
def test_a_node_has_room_for_its_limit_beside_a_large_hand_in(lab: Lab, complete: Machine):
    words, limits = [sys.executable, "-S", "-c", WRITES], Limits(disk=1)
    done = lab.run(shut_in(lab, complete, *words, limits=limits, files="x" * (3 << 20)))
    # A little of the disk is taken by its folders.
    assert done.out.startswith("a\n")
    assert done.err.endswith("OSError: [Errno 28] No space left on device\n")


@pytest.mark.parametrize("machine", [OPEN, pytest.param(None, marks=pytest.mark.needs("sandbox"))])
def test_a_node_has_an_environment_of_its_own(lab: Lab, machine: Machine | None, complete: Machine):
    words = [sys.executable, "-c", "import json, os; print(json.dumps(dict(os.environ)))"]
    done = lab.run(
        shut_in(lab, machine or complete, *words),
        QUADCTL_NODE="safety",
        QUADCTL_IDENTITY="/mine",
        QUADCTL_X="/mine",
        PYTHONPATH="/mine",
        LC_ALL="/mine",
        PATH=f"/mine:{os.environ['PATH']}",
        LANG="de_DE.UTF-8",
    )
    found = done.json
    assert {*found} == {
        "HOME", "LANG", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "PATH", "QUADCTL_NODE",
        "QUADCTL_REALM", "TMPDIR", "XDG_RUNTIME_DIR",
    }, done.err  # fmt: skip
    assert "/mine" not in "".join(found.values())
    assert found["LANG"] == "C.UTF-8"


LEAVES = """
import os, sys, time
if os.fork() == 0:
    if os.fork() == 0:
        os.setsid()
        sleeps = "import time; print('up', flush=True); time.sleep(1000)"
        os.execve(sys.executable, [sys.executable, "-c", sleeps, sys.argv[1]], {})
    os._exit(0)
os.wait()
time.sleep(float(sys.argv[2]))
sys.exit(3)
"""
"""Program that leaves a process with another parent, session and environment."""


def running(lab: Lab) -> list[str]:
    """Return the processes that have the lab's folder in their command line."""
    mark, found = os.fsencode(lab.folder), []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes()
        except OSError:
            continue  # it has ended
        if mark in words and alive(int(path.parent.name)):
            found.append(words.decode())
    return found


def test_what_a_node_leaves_ends_with_it(lab: Lab):
    done = lab.run(shut_in(lab, OPEN, sys.executable, "-c", LEAVES, str(lab.folder), "0"))
    assert (done.code, done.err) == (3, "")
    assert running(lab) == []


JUDGES = """
import os, signal, subprocess, sys
from quadctl.cli.lab.machine import Machine
with Machine().without_orphans():
    with subprocess.Popen(sys.argv[1:], stdout=subprocess.PIPE) as node:
        node.stdout.readline()
        os.kill(node.pid, signal.SIGKILL)
print("judged")
"""


def test_what_a_killed_node_leaves_ends_with_the_judge(lab: Lab):
    command = shut_in(lab, OPEN, sys.executable, "-c", LEAVES, str(lab.folder), "1000")
    done = lab.run([sys.executable, "-c", JUDGES, *command])
    assert (done.out, done.err) == ("judged\n", "")
    assert running(lab) == []


@pytest.mark.parametrize(
    ("machine", "gaps"),
    [
        (Machine(namespaces=True), ""),
        (Machine(user=True, landlock=4), "use the network by UDP"),
        (Machine(user=True), "use the network, read or change what every user may"),
        (Machine(landlock=6), "use the network by UDP, spoil your files, reach your programs"),
        (Machine(landlock=3), "use the network, spoil your files, reach or end your programs"),
        (Machine(), "use the network, read or change your files, reach or end your programs"),
    ],
)
def test_gaps_name_what_a_hand_in_could_do(machine: Machine, gaps: str):
    assert machine.gaps() == gaps


POOR = """
from quadctl.cli.lab import machine, sandbox
from quadctl.cli.main import main
found = machine.Machine(landlock=sandbox.landlock(), lacks="no namespaces: Refused")
machine.probe = lambda: found
main()
"""
"""`quadctl` on a machine without namespaces."""
ARRIVES = (
    '[[row]]\nname = "flies"\nexpect = "arrives"\nend = 7.0\n'
    'rows = [{ at = 4.0, do = "goto", x = 1.0, y = 0.0, z = 1.0 }]\n'
)


@pytest.mark.thorough
def test_without_namespaces_grading_asks_for_trust(lab: Lab):
    good = write("completed", lab.folder)
    rubric = lab.file(ARRIVES, "rubric.toml")
    grade = [sys.executable, "-c", POOR, "lab", "grade", str(good), "--rubric", str(rubric)]
    done = lab.run(grade)
    cannot = (
        "this machine cannot shut hand-ins in completely (no namespaces: Refused): one could use"
    )
    assert (done.code, done.out, cannot in done.err, "--trust" in done.err) == (1, "", True, True)
    trusted = lab.run([*grade, "--trust"], 60.0)
    assert (trusted.code, trusted.out.splitlines()[0]) == (0, f"{good}: 1 of 1 points")
    assert trusted.err.count(cannot) == 1


@pytest.mark.thorough
def test_without_namespaces_a_check_asks_for_no_trust(lab: Lab):
    mine = write("completed", lab.folder)
    (mine / "rubric.toml").write_text(ARRIVES, "utf-8")
    done = lab.run([sys.executable, "-c", POOR, "lab", "check", str(mine)], 60.0)
    assert (done.code, "1 of 1 points" in done.out) == (0, True), done
    assert done.err.count("no namespaces: Refused") == 1
