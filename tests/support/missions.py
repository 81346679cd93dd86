"""Missions for the tests, and the labs to fly them in."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tests.support.lab import Lab, sets

MISSION = """
end = 8.0
rows = [
    { at = 0.0, do = "goto", x = 0.5, y = 0.0, z = 1.0 },
    { at = 2.0, do = "calibrate" },
    { at = 2.0, do = "goto", x = 2.0, y = 1.0, z = 1.5 },
    { at = 2.4, do = "goto", x = -1.0, y = 1.0, z = 1.0 },
    { at = 2.6, do = "goto", x = 0.0, y = -1.0, z = 1.0, replace = true },
    { at = 4.8, do = "goto", x = 9.0, y = 0.0, z = 1.0 },
    { at = 4.83, do = "cage", on = false },
    { at = 4.83, do = "goto", x = 5.5, y = 0.0, z = 1.0 },
    { at = 5.3, do = "cage", on = true },
    { at = 6.4, do = "goto", x = 1.0, y = 1.0, z = 1.0 },
    { at = 6.8, do = "hold" },
]
"""
"""Eight goals: some refused as busy or outside, one replaced, one stopped by the cage."""

SAME = ("hash", "poses", "transitions", "pressure", "counts", "rows")
"""Fields that must be equal in every flight of a mission."""


def start(lab: Lab, *settings: str) -> None:
    """Start a system with these settings, and write the mission file."""
    lab.file(MISSION, "mission.toml")
    lab.start(*sets(*settings))


def fly(lab: Lab, timeout: float = 50.0) -> dict[str, Any]:
    """Fly the mission, and return its document."""
    done = lab.quadctl("fly", "mission.toml", "--json", timeout=timeout)
    assert done.code == 0, done.err
    document: dict[str, Any] = done.json
    return document


def same(flight: dict[str, Any]) -> dict[str, Any]:
    """Return the part of the document that does not depend on the machine."""
    return {name: flight[name] for name in SAME}


@contextmanager
def busy(loops: int) -> Iterator[None]:
    """Run processes that keep a core busy each."""
    running = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(loops)]
    try:
        yield
    finally:
        for one in running:
            one.kill()
        for one in running:
            one.wait()
