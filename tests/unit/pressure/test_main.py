"""Choice of the real sensor's folder, and the timing of readings."""

from pathlib import Path
from typing import cast

import pytest

from quadctl.schemas.messages import Called, Pose
from quadctl.schemas.params import Params
from quadctl.schemas.topics import POSE, POSE_SLOW, POSES, Topic
from quadctl.services.pressure.__main__ import device, run
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.testing import FakeNode
from tests.support.bags import pose


def test_the_configured_folder_is_used_without_a_search(tmp_path: Path):
    assert device("/no/such/folder", tmp_path) == Path("/no/such/folder")


def test_otherwise_the_first_device_with_pressure_is_used(tmp_path: Path):
    for number, name in (
        (0, "in_temp_input"),
        (1, "in_illuminance_raw"),
        (10, "in_pressure_input"),
    ):
        folder = tmp_path / f"iio:device{number}"
        folder.mkdir()
        (folder / name).write_text("1\n")
    assert device("", tmp_path) == tmp_path / "iio:device10"
    (tmp_path / "iio:device2").mkdir()
    (tmp_path / "iio:device2" / "in_pressure_raw").write_text("1\n")
    assert device("", tmp_path) == tmp_path / "iio:device2"


def test_without_a_device_the_error_names_the_searched_folder(tmp_path: Path):
    with pytest.raises(
        QuadctlError, match=f"no device under {tmp_path} measures pressure"
    ) as caught:
        device("", tmp_path)
    assert "pressure.iio" in caught.value.hint


@pytest.mark.parametrize(
    ("rate", "speed", "topic"),
    [(10.0, 1.0, POSE_SLOW), (4.0, 1.0, POSE_SLOW), (15.0, 1.0, POSE), (10.0, 0.0, POSES)],
)
def test_the_barometer_subscribes_to_the_poses_that_its_rate_needs(
    rate: float, speed: float, topic: Topic[Pose]
):
    params = Params()
    params.pressure.rate, params.dynamics.speed = rate, speed
    node = FakeNode("pressure", params, [(POSE, pose(seq)) for seq in range(10)], ())
    run(cast("Node", node), params)
    assert [*node._listeners] == [topic.name]


def test_a_rate_that_is_set_live_brings_the_poses_that_it_needs():
    params, poses = Params(), [(POSE, pose(seq)) for seq in range(100)]
    request = {"values": {"pressure": {"rate": 15.0}}}
    call = Called("b0", 0.5, "pressure/set_params", False, request, {"success": True}, "")
    node = FakeNode("pressure", params, poses, (call,))
    run(cast("Node", node), params)
    assert [*node._listeners] == [POSE.name]
    assert params.pressure.rate == 15.0
