"""Goals, parameters and messages as Foxglove has them."""

import json
from typing import Any

import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.services import GotoRequest
from quadctl.services.bridges.foxglove.translation import by_node, readable, request_of, to_ours
from quadctl.services.runtime.errors import Invalid

POINT = {"x": 1, "y": 2.0, "z": 0.0}


def goal(plain: Any) -> GotoRequest:
    return request_of(json.dumps(plain).encode(), 1.5)


def test_a_point_is_flown_to_as_it_is():
    assert goal(POINT) == GotoRequest(1.0, 2.0, 0.0, replace=True)


@pytest.mark.parametrize("plain", [{"pose": {"position": POINT}}, {"header": {}, "point": POINT}])
def test_a_goal_on_the_ground_as_the_3d_panel_points_there_keeps_the_height(plain):
    assert goal(plain) == GotoRequest(1.0, 2.0, 1.5, replace=True)


def test_a_goal_on_the_ground_needs_the_height():
    with pytest.raises(Invalid, match="not known yet"):
        request_of(json.dumps({"point": POINT}).encode(), None)


def test_a_goal_of_another_frame_is_refused():
    with pytest.raises(Invalid, match="in the frame uav"):
        goal({"header": {"frame_id": "uav"}, "point": POINT})
    for ours in ("map", "world"):
        assert goal({"header": {"frame_id": ours}, "point": POINT | {"z": 1}}).z == 1


@pytest.mark.parametrize(
    "plain", [None, 3, [], {}, {"x": 1}, {"pose": 3}, POINT | {"x": True}, POINT | {"x": "1"}]
)
def test_anything_else_is_refused_with_its_form(plain):
    with pytest.raises(Invalid) as refused:
        goal(plain)
    assert "publish" in refused.value.hint


@given(st.binary(max_size=60))
def test_garbage_is_refused(data):
    with pytest.raises(Invalid):
        request_of(data + b"}", 1.0)


@pytest.mark.parametrize("text", ['{"x": 1e999, "y": 0, "z": 1}', '{"x": NaN, "y": 0, "z": 1}'])
def test_a_goal_that_is_not_finite_is_refused(text):
    with pytest.raises(Invalid):
        request_of(text.encode(), 1.0)


@pytest.mark.parametrize(
    ("given", "present", "ours"),
    [
        (2, 1.0, 2.0), (2, 1, 2), (True, 1.0, True), ("a", 1.0, "a"), ([1, 2], [0.5], [1.0, 2.0]),
        ({"x": 1}, {"x": 0.5}, {"x": 1.0}), ([1], [], [1]), (None, 1.0, None),
    ],
)  # fmt: skip
def test_a_float_without_a_fraction_stays_a_float(given, present, ours):
    found = to_ours(given, present)
    assert (found, repr(found)) == (ours, repr(ours))


def test_values_are_grouped_by_vehicle_and_node():
    given = {
        "uav.safety.takeoff": 2.0,
        "uav.safety.cage_on": True,
        "uav1.dynamics.speed": 1.0,
        "x": 1,
    }
    assert by_node(given) == {
        ("uav", "safety"): {"safety.takeoff": 2.0, "safety.cage_on": True},
        ("uav1", "dynamics"): {"dynamics.speed": 1.0},
        ("x", ""): {"": 1},
    }


@given(
    st.binary(max_size=60), st.sampled_from(["", "zenoh/bytes", "application/msgpack", "text/json"])
)
def test_any_message_is_shown_as_json(payload, encoding):
    assert json.loads(readable(payload, encoding)).keys() == {"data"}


def test_a_number_too_large_for_json_is_shown_as_hex():
    assert json.loads(readable(b"9" * 30, "application/json"))
