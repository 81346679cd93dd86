"""Lock files: they pin the requirements of pyproject.toml on every Python, and name no host."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
RUNTIME = PROJECT["project"]["dependencies"]
PYTHONS = re.findall(r"(?<=Python :: )3\.\d+", " ".join(PROJECT["project"]["classifiers"]))
GROUPS = PROJECT["dependency-groups"]
LOCKS = {
    "requirements.lock": RUNTIME,
    "requirements-build.lock": GROUPS["build"],
    # The group dev includes the groups build and docs.
    "requirements-dev.lock": RUNTIME
    + GROUPS["build"]
    + GROUPS["docs"]
    + [x for x in GROUPS["dev"] if isinstance(x, str)],
}
PIN = re.compile(r"[a-z0-9-]+==[0-9][0-9a-z.]*( ; [A-Za-z0-9_.'<>=! ()]+)? \\")
HASH = re.compile(r"    --hash=sha256:[0-9a-f]{64}( \\)?")


def lines(lock: str) -> list[str]:
    return (ROOT / lock).read_text(encoding="utf-8").splitlines()


def pins(lock: str) -> list[Requirement]:
    return [Requirement(line.removesuffix(" \\")) for line in lines(lock) if PIN.fullmatch(line)]


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_has_only_pins_and_hashes(lock):
    assert [
        line for line in lines(lock) if not PIN.fullmatch(line) and not HASH.fullmatch(line)
    ] == []


def pinned_on(lock: str, python: str, platform: str) -> dict[str, str]:
    """Return the version of each package on a machine."""
    here = {
        "python_full_version": f"{python}.0", "python_version": python, "sys_platform": platform
    }  # fmt: skip
    pinned: dict[str, str] = {}
    for pin in pins(lock):
        if pin.marker is None or pin.marker.evaluate(here):
            assert pin.name not in pinned
            pinned[pin.name] = str(pin.specifier).removeprefix("==")
    return pinned


@pytest.mark.parametrize("python", PYTHONS)
@pytest.mark.parametrize("platform", ["linux", "darwin", "win32"])
@pytest.mark.parametrize("lock", LOCKS)
def test_every_requirement_is_pinned_once(lock, platform, python):
    pinned = pinned_on(lock, python, platform)
    for asked in map(Requirement, LOCKS[lock]):
        assert asked.specifier.contains(pinned[canonicalize_name(asked.name)]), (
            f"{asked}: `make lock`"
        )


def test_users_get_the_tested_versions():
    *given, tested = ({(p.name, str(p.specifier)) for p in pins(lock)} for lock in LOCKS)
    assert set().union(*given) <= tested


@pytest.mark.parametrize("python", PYTHONS)
def test_a_demo_needs_few_packages(python):
    locks = ("requirements.lock", "requirements-build.lock")
    packages = {name for lock in locks for name in pinned_on(lock, python, "linux")}
    # Beside them are pip, setuptools (a part of ensurepip before Python 3.12) and quadctl.
    assert len(packages) + 3 <= 40


def test_the_lock_of_what_builds_us_is_of_what_pyproject_names():
    assert GROUPS["build"] == PROJECT["build-system"]["requires"]
