"""Which vehicle a name means, where it is written as ROS writes it, and what is left of it."""

import pytest

from quadctl.cli.context import Options, about_node, about_parameters
from quadctl.services.runtime.errors import UsageError

OPTIONS = Options("nowhere", "", "uav", json=False, timeout=1.0)


@pytest.mark.parametrize(
    ("word", "left"),
    [
        ("safety.takeoff", "safety.takeoff"),
        ("/safety/takeoff=3", "/safety/takeoff=3"),
        ("uav.safety.takeoff=3", "safety.takeoff=3"),
        ("/uav/safety/takeoff", "safety.takeoff"),
        ("uav/mine/text=/uav/a=b", "mine.text=/uav/a=b"),
        ("/uav", ""),
        ("/", "/"),
        ("uavs.x", "uavs.x"),
    ],
)
def test_a_parameter(word: str, left: str):
    options, words = about_parameters(OPTIONS, [word])
    assert (options.named, words) == ("uav", [left])


def test_parameters_of_a_vehicle_and_of_none():
    with pytest.raises(UsageError, match="different vehicles: safety, uav"):
        about_parameters(OPTIONS, ["/uav/safety", "safety"])


@pytest.mark.parametrize(
    ("name", "left"),
    [
        ("safety", "safety"),
        ("/safety", "/safety"),
        ("/uav/safety", "safety"),
        ("uav/state_safety_node/", "state_safety_node"),
        ("/uav", "/uav"),
        ("other/safety", "other/safety"),
    ],
)
def test_a_node(name: str, left: str):
    assert about_node(OPTIONS, name) == (OPTIONS, left)
