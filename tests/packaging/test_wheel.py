"""Built wheel in a fresh environment, used outside the checkout."""

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from deploy import release
from tests.support.once import once

ROOT = Path(__file__).parents[2]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
SCRIPTS = "Scripts" if os.name == "nt" else "bin"

pytestmark = pytest.mark.thorough


def run(*command: str | Path, cwd: Path) -> str:
    """Return the stdout of a successful command, without this environment's Python variables."""
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        command, cwd=cwd, env=env, capture_output=True, encoding="utf-8", timeout=200, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """Build wheel and sdist from the checkout into a folder."""
    build = (sys.executable, "-m", "build", "--no-isolation", "--wheel", "--sdist", "--outdir")
    return once(tmp_path_factory, "dist", lambda folder: run(*build, folder, cwd=ROOT))


@pytest.fixture(scope="module")
def wheel(built) -> Path:
    [wheel] = built.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("elsewhere")


@pytest.fixture(scope="module")
def scripts(wheel, elsewhere, tmp_path_factory) -> Path:
    """Install the wheel and its pinned dependencies in a fresh environment; return its commands."""

    def install(venv: Path) -> None:
        run(sys.executable, "-m", "venv", "--without-pip", venv, cwd=elsewhere)
        pip = (sys.executable, "-m", "pip", "--python", venv, "install", "--quiet", "--no-compile")
        run(*pip, "--require-hashes", "-r", ROOT / "requirements.lock", cwd=elsewhere)
        run(*pip, "--no-deps", wheel, cwd=elsewhere)

    return once(tmp_path_factory, "fresh", install) / SCRIPTS


def test_the_wheel_has_one_package(wheel):
    run(sys.executable, "-m", "check_wheel_contents", wheel, cwd=ROOT)
    names = zipfile.ZipFile(wheel).namelist()
    dist_info = f"quadctl-{VERSION}.dist-info"
    assert {name.split("/")[0] for name in names} == {"quadctl", dist_info}
    assert len(set(names)) == len(names)
    assert {"quadctl/py.typed", "quadctl/__main__.py", "quadctl/cli/main.py"} <= set(names)
    assert f"{dist_info}/licenses/LICENSE" in names


def test_the_page_of_the_registry_has_no_relative_link(wheel):
    text = zipfile.ZipFile(wheel).read(f"quadctl-{VERSION}.dist-info/METADATA").decode("utf-8")
    links = re.findall(r"\]\(([^)\s]+)\)", text)
    assert f"/raw/v{VERSION}/docs/flight.gif" in " ".join(links)
    assert len(links) > 50
    assert [link for link in links if not link.startswith(("https://", "#"))] == []


def test_the_sdist_builds_the_same_wheel(built, wheel, tmp_path):
    [sdist] = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        # 3.11.0 to 3.11.3 have no filters, and Debian ships 3.11.2.
        archive.extraction_filter = getattr(tarfile, "data_filter", lambda member, _: member)
        archive.extractall(tmp_path)
    [source] = tmp_path.iterdir()
    run(sys.executable, "-m", "build", "--no-isolation", "--wheel", cwd=source)
    [again] = (source / "dist").glob("*.whl")
    assert release.differences(again.read_bytes(), wheel.read_bytes()) == []


def test_the_package_comes_from_the_wheel(scripts, elsewhere):
    code = (
        "import quadctl.schemas.topics, quadctl; print(quadctl.__file__, quadctl.Node.__module__)"
    )
    file, module = run(scripts / "python", "-P", "-c", code, cwd=elsewhere).split()
    assert Path(file).is_relative_to(scripts.parent)
    assert module == "quadctl.services.runtime.node"
    assert VERSION in run(scripts / "python", "-m", "quadctl", "--version", cwd=elsewhere)


def test_modules_named_like_our_folders_do_no_harm(scripts, tmp_path):
    for name in ("schemas", "services", "cli"):
        (tmp_path / f"{name}.py").write_text("raise ImportError('the student's own')\n")
    toml = f'[processes]\nsafety = "{scripts / "python"} my_safety.py"\n'
    (tmp_path / "quad.toml").write_text(toml, encoding="utf-8")
    flags = ("--realm", f"wheel{os.getpid()}")
    quadctl = scripts / "quadctl"
    run(quadctl, "init", "--safety", cwd=tmp_path)
    example = (ROOT / "examples" / "my_safety.py").read_text(encoding="utf-8")
    assert (tmp_path / "my_safety.py").read_text(encoding="utf-8") == example
    run(quadctl, "up", "-d", *flags, cwd=tmp_path)
    try:
        assert "arrived" in run(quadctl, "goto", "1", "0", "1", *flags, cwd=tmp_path)
    finally:
        run(quadctl, "down", *flags, cwd=tmp_path)


def test_quadctl_runs_in_any_folder(scripts, elsewhere):
    quadctl = scripts / "quadctl"
    assert "calibrate" in run(quadctl, "--help", cwd=elsewhere)
    assert VERSION in run(quadctl, "--version", cwd=elsewhere)
    assert "Pose" in run(quadctl, "type", "list", cwd=elsewhere)
    shown = run(quadctl, "type", "show", "calibrate_pressure", cwd=elsewhere)
    assert shown == "bool zero\n---\nfloat64 baseline\n"
    assert list(elsewhere.iterdir()) == []


@pytest.mark.parametrize("bridge", ["foxglove", "mavlink", "ros2"])
def test_a_bridge_needs_its_extra_and_nothing_else(bridge, wheel, scripts, elsewhere):
    def ended() -> tuple[int, str]:
        command = [scripts / "quadctl", "bridge", bridge, "--realm", f"none{os.getpid()}"]
        done = subprocess.run(
            command, cwd=elsewhere, capture_output=True, text=True, timeout=60, check=False
        )
        return done.returncode, done.stderr

    code, said = ended()
    assert (code, f"pip install 'quadctl[{bridge}]'" in said) == (1, True), said
    pip = (sys.executable, "-m", "pip", "--python", scripts.parent, "install", "--quiet")
    run(*pip, f"{wheel}[{bridge}]", cwd=elsewhere)
    code, said = ended()
    # Nothing but a run is missing now.
    assert (code, "nothing is running in the realm" in said) == (3, True), said
