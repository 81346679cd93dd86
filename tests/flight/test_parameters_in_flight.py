"""No value of a limit, gain or body, set in flight, takes the vehicle out of the cage."""

from collections.abc import Iterator
from itertools import count
from math import sqrt
from typing import Any

import pytest
import zenoh
from msgspec import inspect

from quadctl.schemas.params import FROM_STANDSTILL
from quadctl.services.runtime.params import catalogue
from tests.support.bare import Bare, pack, ticket, unpack
from tests.support.lab import private_lab, sets
from tests.support.running import DEADLINE, eventually

CAGE = {"x": 5.0, "y": 5.0, "z": 2.0}
GOAL = {"x": 5.0, "y": 3.0, "z": 2.0}
"""Goal on two walls at once."""
MOMENTS = (0.5, 1.1, 1.9)
"""Simulated seconds: accelerating, at full speed, and braking; the flight begins at 0.2."""
END = 7.0
"""Simulated seconds: two after the standstill at which waiting parameters are adopted."""
MARGIN = 0.01
WAITS = "from the next standstill"
_boots = count()


def values(name: str) -> list[float]:
    """Return the bounds of a parameter, and a value between them."""
    entry = catalogue.leaves()[name]
    assert isinstance(entry.type, inspect.FloatType)
    low, high = entry.type.ge, entry.type.le
    assert low is not None
    assert high is not None
    return [low, sqrt(low * high) if low > 0 else 0.1 * high, high]


NAMES = [name for name in catalogue.leaves() if name.startswith(FROM_STANDSTILL)]


@pytest.fixture(scope="module")
def fast() -> Iterator[Bare]:
    """System at the highest speed (`dynamics.speed=0`), the vehicle in the air."""
    with private_lab() as made:
        made.start(*sets("dynamics.speed=0", "dynamics.start.z=1", "safety.virtual_cage.z=2"))
        with made.bare() as bare:
            yield bare


def excursion(pose: dict[str, Any]) -> float:
    """Return the distance of a pose out of the cage, m."""
    x, y, z = (pose["position"][axis] for axis in "xyz")
    out = (max(abs(x) - CAGE["x"], 0), max(abs(y) - CAGE["y"], 0), max(z - CAGE["z"], -z, 0))
    return sqrt(sum(each * each for each in out))


def reply_fields(reply: zenoh.Reply) -> dict[str, Any]:
    assert reply.ok is not None
    fields: dict[str, Any] = unpack(reply.ok.payload.to_bytes())
    return fields


def fly(bare: Bare, name: str, value: float, moment: float) -> tuple[float, str]:
    """Fly to the wall and set a parameter; return the excursion (m) and the reason of the reply."""
    boot = f"flight{next(_boots)}"
    came: list[bytes] = []
    # Decoded only after the flight: the hub cuts off a reader for which it has to wait.
    listener = bare.session.declare_subscriber(
        "uav/pose", lambda sample: came.append(sample.payload.to_bytes())
    )
    calls = [
        ("goto", GOAL | {"replace": True}, 0.2),
        ("dynamics/set_params", {"values": {name: value}}, moment),
        ("hold", {}, END),
    ]
    waiting = [
        bare.session.get(
            f"uav/@srv/{service}",
            payload=pack(fields),
            attachment=ticket(30, at=at, boot=boot),
            timeout=DEADLINE,
        )
        for service, fields, at in calls
    ]
    reset = bare.query("uav/@srv/reset", pack({}), attachment=ticket(30, boot=boot))
    assert reset.value == {"success": True}
    went, reply, _ = (reply_fields(next(iter(replies))) for replies in waiting)
    assert went["accepted"]
    eventually(lambda: (last := unpack(came[-1]))["boot"] == boot and last["stamp"] >= END)
    listener.undeclare()
    flown = [pose for pose in map(unpack, came) if pose["boot"] == boot]
    return max(map(excursion, flown)), reply["reason"]


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_no_value_set_in_flight_takes_the_vehicle_out_of_the_cage(fast: Bare, name: str):
    default = catalogue.leaves()[name].default
    for value in values(name):
        for moment in MOMENTS:
            farthest, reason = fly(fast, name, value, moment)
            assert farthest <= MARGIN, (value, moment, reason)
            refused = "would not fly" in reason or "no promise" in reason
            assert value == default or WAITS in reason or refused
            assert fast.call("dynamics/set_params", values={name: default}).value["success"]
