"""Abilities that some tests need of the machine: `@pytest.mark.needs("browser")`.

Each is probed once in a run, at its start. Tests that need a missing one are left out, and listed
at the end with its remedy.
"""

import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import NamedTuple

SEARCH = os.pathsep.join((os.environ.get("PATH", ""), "/usr/sbin", "/sbin", "/usr/bin", "/bin"))
"""Search path with the folders of `ip`, which only root's path has."""
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_TOOLS = ("ip", "unshare", "nsenter", "setpriv", "mount")


class Ability(NamedTuple):
    """Probe of an ability, and how to provide it."""

    is_there: Callable[[], bool]
    remedy: str


def browser() -> str | None:
    """Return the path of Chromium, or None."""
    return next(filter(None, map(shutil.which, _BROWSERS)), None)


def as_root() -> list[str]:
    """Return the options of `unshare` that give a user the rights of root in a namespace."""
    return [] if os.geteuid() == 0 else ["--user", "--map-root-user"]


def _works(*command: str) -> bool:
    with suppress(OSError):
        done = subprocess.run(
            command, env=os.environ | {"PATH": SEARCH}, capture_output=True, check=False
        )
        return done.returncode == 0
    return False


def _has_ipv6() -> bool:
    with suppress(OSError), socket.socket(socket.AF_INET6) as probe:
        probe.bind(("::1", 0))
        return True
    return False


def _can_mount() -> bool:
    enter = ("unshare", *as_root(), "--mount", "--net")
    return _works(*enter, "mount", "-t", "tmpfs", "none", "/mnt")


def _has_other_users() -> bool:
    with suppress(OSError), tempfile.NamedTemporaryFile() as file:
        os.chown(file.name, 65534, -1)
        return True
    return False


def _has_sandbox() -> bool:
    from quadctl.cli.lab import machine

    return machine.probe().namespaces


def _rounds_as_recorded() -> bool:
    from tests.golden import data, hashes

    return hashes.probe() == data.read("hashes")["probe"]


ABILITIES = {
    "browser": Ability(
        lambda: browser() is not None, "Chromium or Chrome on the path: apt install chromium"
    ),
    "ip": Ability(
        lambda: all(shutil.which(tool, path=SEARCH) for tool in _TOOLS),
        "the network tools: apt install iproute2 util-linux mount",
    ),
    "mosquitto": Ability(
        lambda: all(
            shutil.which(tool, path=SEARCH)
            for tool in ("mosquitto", "mosquitto_pub", "mosquitto_sub")
        ),
        "a broker of MQTT and its clients: apt install mosquitto mosquitto-clients",
    ),
    "namespaces": Ability(
        lambda: _works("unshare", *as_root(), "--net", "true"),
        "network namespaces: root, or sysctl kernel.unprivileged_userns_clone=1;"
        " in Docker --privileged",
    ),
    "mounts": Ability(_can_mount, "mount namespaces, as above, with / as a mount point"),
    "sandbox": Ability(_has_sandbox, "what the sandbox of `quadctl lab grade` needs: namespaces"),
    "users": Ability(
        _has_other_users, "files of other users: the tests run as root, with all users"
    ),
    "ipv6": Ability(_has_ipv6, "IPv6 on the loopback: sysctl net.ipv6.conf.lo.disable_ipv6=0"),
    "shm": Ability(lambda: os.access("/dev/shm", os.W_OK), "a writable /dev/shm"),
    "rounding": Ability(
        _rounds_as_recorded,
        "sin, cos and exp that round as on the machine that recorded the hashes of flights",
    ),
}


def missing() -> list[str]:
    """Return the names of the abilities that this machine lacks."""
    return [name for name, ability in ABILITIES.items() if not ability.is_there()]


def report(left_out: Iterable[tuple[str, str]]) -> list[str]:
    """Return lines that list left-out tests, given with the ability of each, and their remedies."""
    by_ability: dict[str, list[str]] = {}
    for ability, test in left_out:
        by_ability.setdefault(ability, []).append(test)
    lines = []
    for ability, tests in by_ability.items():
        lines.append(f"{len(tests)} tests need {ability}: {ABILITIES[ability].remedy}")
        lines += [f"    {test}" for test in tests]
    return lines
