"""ROS 1 from Debian's packages: detection, configuration, start and end."""

import os
import socket
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from benchmarks.children import Failed, process
from benchmarks.system import started_with

ROOT = Path(__file__).parents[1]
PACKAGE = Path(__file__).with_name("ros1")
PYTHON = "/usr/bin/python3"
_BIN = Path("/usr/bin")
_TOOLS = ("roscore", "roslaunch", "rosservice", "rostopic", "rosparam", "rosnode", "rossrv")
_NEEDED = "import rospy, std_srvs.srv, std_msgs.msg, geometry_msgs.msg"


@cache
def absent() -> str:
    """Return the reason why ROS is missing, empty if it is installed."""
    lacking = [tool for tool in _TOOLS if not (_BIN / tool).exists()]
    if len(lacking) == len(_TOOLS):
        return "not installed"
    if lacking:
        return f"not installed: no {', '.join(lacking)}"
    tried = subprocess.run(
        [PYTHON, "-c", _NEEDED], env=_bare(), capture_output=True, text=True, check=False
    )
    return f"not installed: {tried.stderr.strip().splitlines()[-1]}" if tried.returncode else ""


@dataclass(frozen=True)
class Ros:
    """Place of one ROS graph: the port of its master and its folder."""

    port: int
    folder: Path

    @property
    def environment(self) -> dict[str, str]:
        """Return the environment of ROS processes, without our packages."""
        return _bare() | {
            "PYTHONPATH": str(ROOT),
            "HOME": str(self.folder),
            "ROS_HOME": str(self.folder),
            "ROS_MASTER_URI": f"http://127.0.0.1:{self.port}",
            "ROS_IP": "127.0.0.1",
            "ROS_ROOT": "/usr/share/ros",
            "ROS_ETC_DIR": "/etc/ros",
            "ROS_DISTRO": "Debian",
            "ROS_VERSION": "1",
            "ROS_PYTHON_VERSION": "3",
            "ROS_PACKAGE_PATH": str(PACKAGE),
        }

    def run(self, *command: str, check: bool = True) -> str:
        """Return the output of a command; raise CalledProcessError if it fails."""
        done = subprocess.run(
            command, env=self.environment, stdin=subprocess.DEVNULL, capture_output=True,
            text=True, timeout=30, check=check,
        )  # fmt: skip
        return done.stdout

    def wait(self, command: Sequence[str], word: str, within: float = 60.0) -> None:
        """Wait until a command prints a word; raise Failed after the time."""
        deadline = time.monotonic() + within
        while word not in self.run(*command, check=False):
            if time.monotonic() > deadline:
                raise Failed(f"{' '.join(command)} does not show {word}")

    def node(self, *words: str) -> tuple[Sequence[str], Mapping[str, str]]:
        """Return the command and environment of a worker of benchmarks/ros1/node.py."""
        return (PYTHON, "-m", "benchmarks.ros1.node", *words), self.environment

    def traffic(self, role: str, size: int) -> list[str]:
        """Return the command of a node that sends `size` bytes as often as one of our nodes."""
        return [PYTHON, str(PACKAGE / "traffic.py"), role, str(size)]

    def pids(self) -> list[int]:
        """Return the pids of every live process of the graph."""
        return started_with("ROS_MASTER_URI", self.environment["ROS_MASTER_URI"])

    def lab(self) -> list[str]:
        """Return the command of the lab's node."""
        return [PYTHON, str(PACKAGE / "lab.py")]


def place(folder: Path) -> Ros:
    """Return a new graph on a free port; start nothing."""
    folder.mkdir()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return Ros(probe.getsockname()[1], folder)


@contextmanager
def master(folder: Path) -> Iterator[Ros]:
    """Run a roscore."""
    ros = place(folder)
    with process(["roscore", "-p", str(ros.port)], ros.environment):
        ros.wait(["rosnode", "list"], "/rosout")
        yield ros


def _bare() -> dict[str, str]:
    private = ("PYTHON", "ROS", "VIRTUAL_ENV", "QUADCTL", "ZENOH")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(private)}
    return kept | {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8"}
