"""A run that the tests of all bridges share, with each bridge beside it."""

from collections.abc import Callable, Iterator

import pytest

from tests.bridges.sides import NAMES, Side, sides
from tests.support.bare import Bare
from tests.support.lab import PATIENT, Lab, private_lab


@pytest.fixture(scope="session")
def bridged_lab() -> Iterator[Lab]:
    """Run in which a process may be frozen for longer than a call takes."""
    with private_lab() as made:
        made.share("--set", "dynamics.start.z=1", "--set", "supervise.answer_timeout=30", *PATIENT)
        yield made


@pytest.fixture(scope="session")
def side_of(bridged_lab: Lab) -> Iterator[Callable[[str], Side]]:
    with sides(bridged_lab) as found:
        yield found


@pytest.fixture
def vehicle(bridged_lab: Lab) -> Iterator[Bare]:
    """Bare session on our bus, with the vehicle at rest at (0, 0, 1) and parameters as launched."""
    with bridged_lab.put_back_session() as session:
        yield session


@pytest.fixture(params=NAMES)
def bridge(request: pytest.FixtureRequest, vehicle: Bare, side_of: Callable[[str], Side]) -> Side:
    return side_of(request.param)


@pytest.fixture
def side(bridge: Side) -> Iterator[Side]:
    """The bridge, with its client connected."""
    with bridge.connect():
        bridge.pose()
        yield bridge
