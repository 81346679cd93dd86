"""How a service may be called: by its very key, its own schema, once, and in time."""

import pytest

from tests.processes.bare import Bare, pack, ticket

GOAL = {"x": 1.0, "y": 0.0, "z": 1.0}


@pytest.mark.parametrize(
    "pattern",
    [
        "uav/@srv/*",
        "*/@srv/toggle_cage",
        "uav/@srv/toggle$*",
        "uav/@srv/**",
        "uav/@srv/toggle_cag$*",
    ],
)
def test_a_pattern_executes_nothing(hover: Bare, pattern: str):
    answers = hover.answers(pattern, pack({"cage_on": False}))
    assert not [answer for answer in answers if answer.ok]
    assert {answer.code for answer in answers} <= {"invalid"}
    state = hover.state()
    assert (state["cage_on"], state["state"]) == (True, "HOVERING")


def test_verbatim_services_are_not_found_by_double_stars(hover: Bare):
    assert hover.answers("uav/**/toggle_cage", pack({"cage_on": False})) == []
    assert hover.state()["cage_on"]


def test_another_schema_is_refused_and_both_are_named(hover: Bare):
    encoding = "application/msgpack;quadctl.GotoRequest#deadbeef"
    answer = hover.query("uav/@srv/goto", pack(GOAL), encoding=encoding)
    assert (answer.ok, answer.code) == (False, "invalid")
    assert "GotoRequest#deadbeef" in answer.value["message"]
    ours = answer.value["message"].rpartition("GotoRequest#")[2][:8]
    assert ours != "deadbeef"
    named = f"application/msgpack;quadctl.GotoRequest#{ours}"
    assert hover.query("uav/@srv/goto", pack(GOAL), encoding=named).value["accepted"]


def test_another_type_is_refused_and_no_digest_is_checked_by_fields(hover: Bare):
    wrong = "application/msgpack;quadctl.HoldRequest"
    assert hover.query("uav/@srv/goto", pack(GOAL), encoding=wrong).code == "invalid"
    plain = "application/msgpack;quadctl.GotoRequest"
    answer = hover.query("uav/@srv/goto", pack(GOAL), encoding=plain)
    assert answer.value == {"accepted": True, "reason": ""}
    assert answer.encoding.startswith("application/msgpack;quadctl.GotoResponse#")


def test_a_topic_with_another_schema_is_not_taken(hover: Bare):
    before = hover.state()["request"]
    encoding = "application/msgpack;quadctl.Waypoint#deadbeef"
    hover.session.put("uav/input/position_request", pack(GOAL), encoding=encoding)
    assert hover.call("safety/get_params", names=[]).ok
    assert hover.state()["request"] == before


def test_the_same_id_is_executed_once_and_answered_alike(hover: Bare):
    first, before = ticket(30), hover.state()["request"]
    answers = [
        hover.query("uav/@srv/goto", pack(GOAL | {"replace": True}), attachment=first)
        for _ in range(3)
    ]
    assert [answer.value for answer in answers] == [{"accepted": True, "reason": ""}] * 3
    assert hover.state()["request"] == before + 1
    # A refusal is repeated too, though by now it would be granted.
    second = ticket(30)
    refused = hover.query("uav/@srv/goto", pack({"x": 9.0, "y": 0, "z": 1}), attachment=second)
    assert not refused.value["accepted"]
    hover.call("toggle_cage", cage_on=False)
    assert hover.query("uav/@srv/goto", pack(GOAL), attachment=second) == refused


def test_past_its_deadline_a_call_is_expired_and_not_executed(hover: Bare):
    payload = pack({"cage_on": False})
    late = hover.query("uav/@srv/toggle_cage", payload, attachment=ticket(-0.1))
    assert (late.ok, late.code) == (False, "expired")
    assert hover.state()["cage_on"]
    assert hover.query("uav/@srv/toggle_cage", payload, attachment=ticket(10)).ok
    assert not hover.state()["cage_on"]


def test_an_id_answered_before_its_deadline_is_answered_after_it_too(hover: Bare):
    payload = pack({"cage_on": False})
    assert hover.query("uav/@srv/toggle_cage", payload, attachment=ticket(30, "once")).ok
    hover.call("toggle_cage", cage_on=True)
    assert hover.query("uav/@srv/toggle_cage", payload, attachment=ticket(-1, "once")).ok
    assert hover.state()["cage_on"]


@pytest.mark.parametrize("attachment", [b"", b"\xc1", pack({"id": "a"}), pack({"deadline": 1.0})])
def test_a_broken_attachment_is_invalid_and_the_call_is_not_executed(
    hover: Bare, attachment: bytes
):
    payload = pack({"cage_on": False})
    answer = hover.query("uav/@srv/toggle_cage", payload, attachment=attachment)
    if attachment:
        assert (answer.ok, answer.code) == (False, "invalid")
        assert hover.state()["cage_on"]
