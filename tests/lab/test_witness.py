"""Witness of a row's flight: what it keeps, and when it gives a flood up."""

import re

import pytest
from msgspec.structs import replace

from quadctl.cli.lab.flown import Witness
from quadctl.schemas.messages import CageSize, Position, Pressure, SafetyState
from quadctl.services.runtime.errors import QuadctlError

STATE = SafetyState("b", 0.5, 1, "MOVING", Position(0, 0, 1), True, CageSize(5, 5, 5), "")


def test_it_keeps_the_states_of_its_boot_and_the_newest_readings():
    witness = Witness("b", 4.0)
    for message in (STATE, replace(STATE, boot="a"), Pressure(3.0, 1, 0, 0, 0)):
        witness.add(message)
    witness.add(newest := Pressure(1.0, 2, 0, 0, 0))
    witness.add(Pressure(5.0, 3, 0, 0, 0))
    assert (witness.states, witness.readings) == ([STATE], [newest])


@pytest.mark.parametrize(
    ("flood", "why"),
    [
        (lambda _n: STATE, "safety published 5001 messages on safety/state until 0 s: 20 a second"),
        (
            lambda n: Pressure(n / 2000, 0, 0, 0, 0),
            "pressure published 5001 messages on sensors/pressure until 0 s: 10 a second",
        ),
    ],
)
def test_a_flood_ends_the_flight(flood, why: str):
    witness = Witness("b", 4.0)
    for number in range(5_000):
        witness.add(flood(number))
    with pytest.raises(QuadctlError, match=re.escape(why)):
        witness.add(flood(5_000))
