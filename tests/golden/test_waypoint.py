"""Today's safety reads the lab's fire-and-forget waypoint from a recorded publisher."""

from collections.abc import Iterator

import pytest

from tests.golden import data
from tests.support.bare import Bare
from tests.support.lab import PATIENT, private_lab

KEY = "uav/input/position_request"
WAYPOINT = data.read("encoded")["types"]["Waypoint"]
ENCODING = data.read("messages")["Waypoint"]["encoding"]


@pytest.fixture(scope="module")
def current() -> Iterator[Bare]:
    """Bare session on a running system of the current version."""
    with private_lab() as lab:
        lab.start("--set", "dynamics.start.z=1", *PATIENT)
        with lab.bare() as bare:
            yield bare


@pytest.mark.parametrize("encoding", [ENCODING, "application/msgpack"])
def test_a_recorded_waypoint_gets_its_verdict(current: Bare, encoding: str):
    assert data.read("keys")["topics"][KEY]["type"] == "Waypoint"
    states, before = current.watch("uav/safety/state"), current.state()
    current.session.put(KEY, bytes.fromhex(WAYPOINT["hex"]), encoding=encoding)
    state = states.until(lambda said: said["request"] == before["request"] + 1)
    # The recorded point is below the floor.
    assert WAYPOINT["value"]["z"] < 0
    state = states.until(lambda said: said["state"] == "HOVERING")
    assert (state["request"], state["goal"]) == (before["request"] + 1, before["goal"])
    assert state["reason"]


def test_a_waypoint_of_another_schema_is_not_flown(current: Bare):
    states, before = current.watch("uav/safety/state"), current.state()
    payload = bytes.fromhex(WAYPOINT["hex"])
    current.session.put(KEY, payload, encoding=ENCODING[:-8] + "00000000")
    current.session.put(KEY, payload, encoding=ENCODING)
    counted = before["request"] + 1
    assert states.until(lambda said: said["request"] > before["request"])["request"] == counted
    assert current.call("hold").ok
    assert current.state()["request"] == counted
