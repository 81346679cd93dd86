"""README's two commands on bare machines, for `make machines`: Debian 12, 13 and its development suite.

    python3 tests/machines.py [SUITE...]

A machine is a folder below .cache/machines with git, make, python3, python3-venv and certificates, from
the mirror of this machine's apt; pip has this machine's configuration. Each command runs as root in a fresh clone
of the last commit. Its mounts and processes are in namespaces that end with it.
"""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
MACHINES = ROOT / ".cache" / "machines"
PIP_CACHE = MACHINES / "pip"
SUITES = ("bookworm", "trixie", "sid")
PACKAGES = "git,make,python3,python3-venv,ca-certificates"
PIP_CONFIGURED = ("/etc/pip.conf", "/etc/xdg/pip", "~/.config/pip", "~/.pip")
CHECKOUT = "root/quadctl"
"""Place of the clone on a machine."""
PASSED_ON = re.compile(r"PIP_|SSL_|REQUESTS_|(https?|no)_proxy$", re.IGNORECASE)
"""Variables of the environment by which pip reaches its index."""
NAMESPACES = ("unshare", "--mount", "--pid", "--ipc", "--fork", "--kill-child")
# The shell stays, as the first process of its namespace, to reap processes whose parents have ended.
ENTER = """
mount --rbind /dev "$1/dev"; mount -t tmpfs none "$1/dev/shm"
mount --rbind /sys "$1/sys"; mount -t proc proc "$1/proc"
root=$1 command=$2; shift 2
for path; do mount --bind "${path%:*}" "$root${path#*:}"; done
chroot "$root" sh -c "cd ~/quadctl && $command"; exit $?
"""


class Result(NamedTuple):
    """Outcome of both commands on a machine."""

    suite: str
    python: str
    demo: float  # s
    packages: int
    tests: str
    left_out: str
    ok: bool

    def __str__(self) -> str:
        """Return the lines of a summary."""
        text = (
            f"{self.suite}: Python {self.python}, make demo {self.demo:.0f} s with {self.packages}"
            f" packages, make test: {self.tests}"
        )
        return text + "".join(f"\n  left out: {line}" for line in self.left_out.splitlines())


def main(*suites: str) -> int:
    """Try both commands on the machines of the suites; return the exit code."""
    if os.geteuid() != 0:
        sys.exit(
            "make machines needs root, to lay Debian in a folder and enter it: sudo make machines"
        )
    _require_mmdebstrap()
    PIP_CACHE.mkdir(parents=True, exist_ok=True)
    results = []
    for suite in suites or SUITES:
        results.append(_try(suite, _laid(suite)))
        print(results[-1], flush=True)
    return 0 if all(result.ok for result in results) else 1


def _require_mmdebstrap() -> None:
    """Install mmdebstrap if it is missing and apt is there."""
    if shutil.which("mmdebstrap"):
        return
    if shutil.which("apt-get"):
        subprocess.run(["apt-get", "update", "-qq"], check=False)
        install = ["apt-get", "install", "-y", "-qq", "--no-install-recommends", "mmdebstrap"]
        subprocess.run(install, check=False, stdout=subprocess.DEVNULL)
    if not shutil.which("mmdebstrap"):
        sys.exit(
            "make machines lays Debian by mmdebstrap, which is missing: apt install mmdebstrap"
        )


def _laid(suite: str) -> Path:
    """Return the folder of a machine, laid now if it is not there."""
    root = MACHINES / suite
    if root.exists():
        return root
    print(f"laying {suite} in {root}", flush=True)
    part = root.with_name(f"{suite}.part")
    shutil.rmtree(part, ignore_errors=True)
    options = [
        f"--aptopt={line}" for line in _said("apt-config", "dump") if line.startswith("Acquire::")
    ]
    described = ("Created-By: Packages", "Origin: Debian", "Label: Debian", "Component: main")
    mirrors = list(_said("apt-get", "indextargets", "--format=$(REPO_URI)", *described))
    done = subprocess.run(
        ["mmdebstrap", "--quiet", "--variant=minbase", f"--include={PACKAGES}", *options, suite, part, *mirrors[:1]],
        check=False,
    )  # fmt: skip
    if done.returncode:
        sys.exit(f"mmdebstrap cannot lay {suite}: its reason is above")
    return part.rename(root)


def _try(suite: str, root: Path) -> Result:
    """Run both commands in a fresh clone on a machine."""
    checkout, log = root / CHECKOUT, MACHINES / f"{suite}.log"
    shutil.rmtree(checkout, ignore_errors=True)
    clone = ["git", "-c", "safe.directory=*", "clone", "--quiet", "--no-hardlinks", ROOT, checkout]
    subprocess.run(clone, check=True)
    print(f"{suite}: make demo, make test; output in {log}", flush=True)
    with log.open("wb") as out:
        start = time.monotonic()
        flown = _enter(root, "make demo", out)
        demo = time.monotonic() - start
        packages = len(list(checkout.glob(".venv/lib/*/site-packages/*.dist-info")))
        tested = _enter(root, "make test", out)
    said = log.read_text("utf-8", errors="replace")
    ...


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
