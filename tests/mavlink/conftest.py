"""A run with a ground station."""

from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import common as mavlink

import quadctl
from tests.support.mavlink import GroundStation, bridge, near
from tests.support.running import eventually


@pytest.fixture(scope="module")
def run() -> Iterator[quadctl.Run]:
    with quadctl.launch() as run:
        yield run


@pytest.fixture(scope="module")
def station(run: quadctl.Run) -> Iterator[GroundStation]:
    with GroundStation() as station, bridge(run.realm, station.port):
        station.wait("HEARTBEAT")
        yield station


@pytest.fixture
def flying(station: GroundStation, run: quadctl.Run) -> GroundStation:
    """The station, with the vehicle in the air at the same place before each test."""
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
    assert station.goto(0, 0, 1) == 0
    eventually(lambda: near(run, (0, 0, 1)))
    return station
