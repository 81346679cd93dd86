"""A live lab, its console and a browser, for the tests of one module to share."""

from collections.abc import Iterator

import pytest

from tests.console.browser import Browser, browser
from tests.console.served import Console, served
from tests.processes.lab import Lab, private_lab

# On a machine that is busy drawing a page, a pose may be late.
SETTINGS = [
    word
    for name in ("dynamics.start.z=1", "safety.virtual_cage.z=2", "safety.pose_timeout=5")
    for word in ("--set", name)
]


@pytest.fixture(scope="module")
def flown() -> Iterator[Lab]:
    """A running system with one vehicle, in the air at (0, 0, 1)."""
    with private_lab() as made:
        made.start(*SETTINGS)
        yield made


@pytest.fixture(scope="module")
def console(flown: Lab) -> Iterator[Console]:
    """Its console."""
    with served(flown) as made:
        yield made


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """A browser with an empty profile."""
    with browser() as made:
        yield made
