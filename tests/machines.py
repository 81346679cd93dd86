"""README's two commands on bare machines, for `make machines`: Debian 12, 13 and its development suite.

    python3 tests/machines.py [SUITE...]
    python3 tests/machines.py --wheel FILE --uv REQUIREMENT [SUITE...]

The second command installs a wheel there instead, as `deploy/installed.py` does, for `make release`.
A machine is a folder below .cache/machines with git, make, python3, python3-venv and certificates, from the
mirror of this machine's apt; its pip has this machine's configuration. Each command runs as root in a fresh
clone of the last commit. Its mounts and processes are in namespaces that end with it.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
MACHINES = ROOT / ".cache" / "machines"
PIP_CACHE = MACHINES / "pip"
SUITES = ("bookworm", "trixie", "sid")
PACKAGES = "git,make,python3,python3-venv,ca-certificates"
MIRROR = ("Created-By: Packages", "Origin: Debian", "Label: Debian", "Component: main")
"""Properties of the source of apt that is a mirror of Debian, without security and backports."""
CHECKOUT = "root/quadctl"
"""Place of the clone on a machine."""
PASSED_ON = re.compile(r"(PIP|UV)_(?!CACHE_DIR)|SSL_|REQUESTS_|(https?|no)_proxy$", re.IGNORECASE)
"""Environment variables by which pip and uv reach their index."""
ENTER = """
set -e
root=$1 cache=$2 command=$3; shift 3
mount --rbind /dev "$root/dev"; mount -t tmpfs none "$root/dev/shm"
mount --rbind /sys "$root/sys"; mount -t proc none "$root/proc"
mount --bind "$cache" "$root/root/quadctl/.cache/pip"
while [ $# -gt 0 ]; do mount -o bind,ro "$1" "$root$2"; shift 2; done
code=0; chroot "$root" sh -c "cd /root/quadctl && $command" || code=$?
exit $code
"""
"""Script in new namespaces. It waits: their first process is the one that reaps orphans."""


class Result(NamedTuple):
    """Outcome of the commands on a machine."""

    ok: bool
    summary: str


def main(*words: str) -> int:
    """Try README's commands or a wheel on the machines of the suites; return the exit code."""
    parser = argparse.ArgumentParser(description="Try README's commands on bare machines.")
    parser.add_argument("--wheel", type=Path, help="install this wheel there instead")
    parser.add_argument("--uv", help="requirement of uv, which installs it, too")
    parser.add_argument("suites", nargs="*", default=SUITES, metavar="SUITE")
    asked = parser.parse_args(words)
    if os.geteuid() != 0:
        sys.exit(
            "make machines lays Debian in a folder and enters it, as root only: sudo make machines"
        )
    require_mmdebstrap()
    PIP_CACHE.mkdir(parents=True, exist_ok=True)
    results = [
        installation(suite, laid(suite), asked.wheel, asked.uv)
        if asked.wheel
        else trial(suite, laid(suite))
        for suite in asked.suites
    ]
    print(*(result.summary for result in results), sep="\n")
    return 0 if all(result.ok for result in results) else 1


def require_mmdebstrap() -> None:
    """Install mmdebstrap if it is missing and apt is there."""
    if shutil.which("mmdebstrap") is None and shutil.which("apt-get"):
        subprocess.run(["apt-get", "update", "-qq"], check=False)
        subprocess.run(
            ["apt-get", "install", "-y", "-qq", "--no-install-recommends", "mmdebstrap"],
            check=False, stdout=subprocess.DEVNULL,
            env={**os.environ, "DEBIAN_FRONTEND": "noninteractive"},
        )  # fmt: skip
    if shutil.which("mmdebstrap") is None:
        sys.exit(
            "make machines lays Debian by mmdebstrap, which is missing: apt install mmdebstrap"
        )


def laid(suite: str) -> Path:
    """Return the folder of a machine; lay it if there is none."""
    root, part = MACHINES / suite, MACHINES / f"{suite}.part"
    if not root.exists():
        print(f"{suite}: laying it in {root}", flush=True)
        shutil.rmtree(part, ignore_errors=True)
        settings = [line for line in lines("apt-config", "dump") if line.startswith("Acquire::")]
        mirrors = lines("apt-get", "indextargets", "--format=$(REPO_URI)", *MIRROR)
        options = ["--quiet", "--variant=minbase", f"--include={PACKAGES}"]
        options += [f"--aptopt={setting}" for setting in settings]
        if subprocess.run(
            ["mmdebstrap", *options, suite, part, *mirrors[:1]], check=False
        ).returncode:
            sys.exit(f"mmdebstrap could not lay {suite}, for the reason above")
        part.rename(root)
    return root


def lines(*command: str) -> list[str]:
    """Return the lines that a command prints."""
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()


def trial(suite: str, root: Path) -> Result:
    """Run both commands in a fresh clone on a machine."""
    checkout, log = clone(root), MACHINES / f"{suite}.log"
    print(f"{suite}: make demo, make test; their output is in {log}", flush=True)
    with log.open("wb") as out:
        began = time.monotonic()
        flown = enter(root, "make demo", out)
        seconds = time.monotonic() - began
        packages = len(list(checkout.glob(".venv/lib/*/site-packages/*.dist-info")))
        tested = flown and enter(root, "make test", out)
    said = log.read_text("utf-8", errors="replace")
    demo = f"{seconds:.0f} s with {packages} packages" if flown else "failed"
    counts = re.findall(r"^=* ?(\d+ [a-z]+.* in [\d.]+s\b.*?)=*$", said, re.MULTILINE)
    left_out = re.findall(r"^=+ NOT TESTED =+\n(.*?)(?=^=)", said, re.MULTILINE | re.DOTALL)
    summary = [
        f"{suite} ({python_of(root)}): make demo {demo}; make test {counts[-1].strip() if counts else 'failed'}",
        *(f"  not tested: {line}" for line in "".join(left_out).splitlines()),
    ]
    return Result(tested, "\n".join(summary))


def installation(suite: str, root: Path, wheel: Path, uv: str) -> Result:
    """Install and use a wheel on a machine, in fresh environments."""
    checkout, log = clone(root), MACHINES / f"{suite}-wheel.log"
    (checkout / "dist").mkdir()
    shutil.copy(wheel, checkout / "dist")
    print(f"{suite}: {wheel.name}; the output is in {log}", flush=True)
    with log.open("wb") as out:
        pip = "PIP_CACHE_DIR=/root/quadctl/.cache/pip PIP_ROOT_USER_ACTION=ignore"
        ok = enter(root, f"{pip} python3 deploy/installed.py dist/{wheel.name} {uv}", out)
    said = log.read_text("utf-8", errors="replace").strip()
    return Result(
        ok, f"{suite} ({python_of(root)}): {wheel.name} {'ok' if ok else 'failed'}\n{said}"
    )


def clone(root: Path) -> Path:
    """Return a fresh clone of the last commit on a machine."""
    checkout = root / CHECKOUT
    shutil.rmtree(checkout, ignore_errors=True)
    # The checkout may belong to the user who called sudo.
    git = ("git", "-c", "safe.directory=*", "clone", "--quiet", "--no-hardlinks")
    subprocess.run([*git, ROOT, checkout], check=True)
    return checkout


def python_of(root: Path) -> str:
    """Return the version of a machine's Python."""
    return lines("chroot", str(root), "python3", "--version")[0]


def enter(root: Path, command: str, out: IO[bytes]) -> bool:
    """Run a command in the clone on a machine; return its success."""
    shown = [Path("/etc/resolv.conf"), Path("/etc/hosts"), *pip_configured()]
    for path in shown:
        make_place(path, root)
    (root / CHECKOUT / ".cache/pip").mkdir(parents=True, exist_ok=True)
    # What runs there ends with this process, however this ends.
    namespaces = (
        "setpriv",
        "--pdeathsig",
        "KILL",
        "unshare",
        "--mount",
        "--pid",
        "--ipc",
        "--fork",
        "--kill-child",
    )
    binds = [word for path in shown for word in (path, place(path))]
    done = subprocess.run(
        [*namespaces, "sh", "-c", ENTER, "sh", root, PIP_CACHE, command, *binds],
        check=False, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT,
        env={
            "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
            "HOME": "/root", "LANG": "C.UTF-8", "TERM": "xterm",
            **{name: value for name, value in os.environ.items() if PASSED_ON.match(name)},
        },
    )  # fmt: skip
    return done.returncode == 0


def pip_configured() -> Iterator[Path]:
    """Yield the files of pip's configuration, and all that they and the environment name."""
    texts = [value for name, value in os.environ.items() if PASSED_ON.match(name)]
    for name in (
        "/etc/pip.conf",
        "/etc/xdg/pip/pip.conf",
        "~/.config/pip/pip.conf",
        "~/.pip/pip.conf",
    ):
        file = Path(name).expanduser()
        if file.exists():
            yield file
            texts.append(file.read_text("utf-8"))
    for word in " ".join(texts).replace("=", " ").split():
        path = Path(word.removeprefix("file://"))
        if path.is_absolute() and path.exists():
            # The pages of an index link to files beside them.
            yield path.parent if path.name == "simple" else path


def place(path: Path) -> Path:
    """Return the place of one of this machine's files on another machine, whose home is root's."""
    home = Path.home()
    return Path("/root", path.relative_to(home)) if path.is_relative_to(home) else path


def make_place(path: Path, root: Path) -> None:
    """Make an empty file or folder to mount a path on."""
    target = root / place(path).relative_to("/")
    target.parent.mkdir(parents=True, exist_ok=True)
    if path.is_dir():
        target.mkdir(exist_ok=True)
    else:
        target.touch()


if __name__ == "__main__":
    try:
        sys.exit(main(*sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit("interrupted: nothing runs on the machines any more, and nothing is mounted")
