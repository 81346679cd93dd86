"""Set-up by make, of a tiny project in place of ours: on machines that cannot do it, and cut off half-way."""

import fcntl
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.poor_machines import poor, small_disk
from tests.support.running import eventually

ROOT = Path(__file__).parents[2]
PYPROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "tiny"
version = "1"
scripts = {quadctl = "tiny:main"}

[tool.hatch.build]
dev-mode-dirs = ["."]
"""
NOWHERE = f"nowhere==1 --hash=sha256:{'0' * 64}\n"
TOOLS = ("pip", "hatchling", "packaging", "pathspec", "pluggy", "tomlkit", "trove_classifiers")
"""Packages that pip needs to install the tiny project."""
PIP = """
import os, pathlib, sys, sysconfig
for lock in [word.partition("=")[2] for word in sys.argv if word.startswith("--requirement=")]:
    if "nowhere" in pathlib.Path(lock).read_text():
        sys.exit("ERROR: Could not find a version (from versions: none)")
    pathlib.Path(sysconfig.get_path("purelib"), lock).write_text(str(os.getppid()))
    if pathlib.Path("gate").exists() and "dev" in lock:
        pathlib.Path("gate").read_text()
script = pathlib.Path(sys.prefix, "bin", "quadctl")
script.write_text("#!/bin/sh\\necho flown\\n")
script.chmod(0o755)
"""
"""Stand-in for pip, quick; it stops half-way at a pipe named gate until this was written to."""
QUICK = "import venv; venv.EnvBuilder._setup_pip = lambda *_: None"
"""Environments get no pip of their own: the modules of the machine have one."""


class Checkout:
    """Checkout of a tiny project with our Makefile, on a machine with one Python."""

    def __init__(self, folder: Path, machine: Path) -> None:
        self.folder, self.machine, self.venv = folder, machine, folder / ".venv"
        (folder / "deploy").mkdir(parents=True)
        for name in ("Makefile", "deploy/environment.py"):
            shutil.copy(ROOT / name, folder / name)
        for name in ("requirements.lock", "requirements-build.lock", "requirements-dev.lock"):
            (folder / name).touch()
        (folder / "pyproject.toml").write_text(PYPROJECT, "utf-8")
        (folder / "tiny.py").write_text("def main():\n    print('flown')\n", "utf-8")
        machine.mkdir()
        for tool in ("make", "sh", "sleep"):
            (machine / tool).symlink_to(shutil.which(tool) or tool)

    def python(self, customised: str = QUICK, tools: tuple[str, ...] = ()) -> None:
        """Give the machine a Python that runs a line of code first, with real tools or a stand-in for pip."""
        modules = self.machine / "modules"
        modules.mkdir()
        (modules / "sitecustomize.py").write_text(customised, "utf-8")
        for name in tools:
            (modules / name).symlink_to(Path(sysconfig.get_path("purelib"), name))
        if not tools:
            (modules / "pip.py").write_text(PIP, "utf-8")
        python = self.machine / "python3"
        python.write_text(
            f'#!/bin/sh\nPYTHONPATH="{modules}" exec "{sys.executable}" "$@"\n', "utf-8"
        )
        python.chmod(0o755)

    def start(self, *words: str, on: list[str] | None = None) -> subprocess.Popen[str]:
        """Start make with this machine's programs alone."""
        env = {"PATH": str(self.machine), "PIP_CONFIG_FILE": os.devnull}
        return subprocess.Popen(
            [*(on or []), str(self.machine / "make"), "--directory", str(self.folder), *words],
            env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip

    def make(self, *words: str, on: list[str] | None = None) -> str:
        """Run make, which must succeed; return its output."""
        with self.start(*words, on=on) as made:
            out, err = made.communicate(timeout=60)
        assert made.returncode == 0, out + err
        return out

    def refusal(self, *words: str, on: list[str] | None = None) -> str:
        """Run make, which must fail; return the only line that is not its own."""
        with self.start(*words, on=on) as made:
            _, err = made.communicate(timeout=60)
        assert made.returncode == 2, err
        [line] = [line for line in err.splitlines() if not line.startswith("make: ")]
        return line

    def is_free(self) -> bool:
        """Return whether no set-up holds the checkout."""
        with (self.folder / ".cache" / "set-up.lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return False
        return True

    def content(self) -> set[Path]:
        """Return all files and folders but the cache."""
        return (
            set(self.folder.rglob("*"))
            - set((self.folder / ".cache").rglob("*"))
            - {self.folder / ".cache"}
        )


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    return Checkout(tmp_path / "checkout", tmp_path / "machine")


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("customised", "told"),
    [
        (None, "There is no python3: install Python 3.11 or newer (Debian, Ubuntu: apt install"),
        ("import sys; sys.version_info = (3, 9, 2, 'final', 0)", "is 3.9: install one, or name one: make PYTHON="),
        ("import sys; sys.modules['ensurepip'] = None", "has no ensurepip: install it (Debian, Ubuntu: apt install"),
    ],
)  # fmt: skip
def test_a_python_that_does_not_fit_is_told_in_one_line(checkout, customised, told):
    if customised:
        checkout.python(customised)
    before = checkout.content()
    for target in ("demo", "test"):
        assert told in checkout.refusal(target)
    assert checkout.content() == before


@pytest.mark.thorough
@pytest.mark.needs("ip", "mounts")
@pytest.mark.parametrize(
    ("machine", "told"),
    [
        (lambda folder: "true", "No package index answers: connect this machine to one"),
        (
            lambda folder: (
                f"cp -r {folder} {folder}-0; {small_disk(folder, '9m')}; cp -r {folder}-0/. {folder}"
            ),
            "(9 MB are free): make room for 500 MB there",
        ),
        (
            lambda folder: f"mount --bind {folder} {folder}; mount -o remount,bind,ro {folder}",
            "(Read-only file system): use a checkout that you may write to",
        ),
    ],
    ids=["offline", "full", "read-only"],
)
def test_a_machine_that_cannot_set_up_is_told_in_one_line(
    checkout: Checkout, machine: Callable[[Path], str], told: str
):
    checkout.python(tools=TOOLS)
    (checkout.folder / "requirements.lock").write_text(NOWHERE, "utf-8")
    before = checkout.content()
    script = f"PATH={os.environ['PATH']}; {machine(checkout.folder)}; PATH={checkout.machine}"
    assert told in checkout.refusal("demo", on=poor(script))
    assert checkout.content() == before


@pytest.mark.thorough
def test_any_path_will_do(tmp_path):
    checkout = Checkout(tmp_path / "a folder's name" / "deep" / ("long" * 50), tmp_path / "machine")
    checkout.python(tools=TOOLS)
    assert "flown" in checkout.make("demo")


@pytest.mark.thorough
def test_developers_extend_the_environment_of_users(checkout):
    checkout.python()
    assert "Setting up" in checkout.make("demo")
    (checkout.venv / "kept").touch()
    checkout.make(".venv/.ready")
    assert (checkout.venv / "kept").exists()
    assert "Setting up" not in checkout.make("demo") + checkout.make(".venv/.ready")


@pytest.mark.thorough
def test_what_fails_leaves_the_environment_as_it_was(checkout):
    checkout.python()
    checkout.make("demo")
    before = checkout.content()
    (checkout.folder / "requirements-dev.lock").write_text(NOWHERE, "utf-8")
    assert "No package index answers" in checkout.refusal("test")
    assert "Setting up" not in checkout.make("demo")
    (checkout.folder / "requirements.lock").write_text(NOWHERE, "utf-8")
    assert "No package index answers" in checkout.refusal("demo")
    assert checkout.content() == before
    assert subprocess.check_output(checkout.venv / "bin" / "quadctl", text=True) == "flown\n"


@pytest.mark.thorough
@pytest.mark.parametrize("cut", ["Ctrl-C", "SIGTERM", "SIGKILL"])
def test_a_set_up_cut_off_half_way_is_not_taken_for_ready(checkout, cut):
    checkout.python()
    checkout.make(".venv/.demo-ready")
    gate = checkout.folder / "gate"
    os.mkfifo(gate)
    with checkout.start(".venv/.ready") as make:
        [half] = eventually(lambda: list(checkout.venv.rglob("requirements-dev.lock")), 30)
        if cut == "Ctrl-C":
            os.killpg(make.pid, signal.SIGINT)
        elif cut == "SIGTERM":
            make.terminate()
        else:
            os.kill(int(eventually(half.read_text)), signal.SIGKILL)
        make.communicate(timeout=30)
    if cut == "SIGKILL":
        assert "Another make sets up" in checkout.refusal("demo")
        gate.write_text("")  # pip, which lived on, ends
    gate.unlink()
    assert not {".demo-ready", ".ready"} & {path.name for path in checkout.venv.iterdir()}
    eventually(checkout.is_free)
    (checkout.venv / "half").touch()
    checkout.make(".venv/.ready")
    assert not (checkout.venv / "half").exists()
