"""Rules of a service call: exact key, matching schema, executed once, before its deadline."""

from collections.abc import Iterator
from typing import Any

import pytest
import zenoh

from quadctl.schemas.services import HoldResponse
from quadctl.services.runtime.bus import codec
from tests.support.bare import Answer, Bare, pack, ticket, unpack
from tests.support.flooder import FAR, GOAL, SERVICES
from tests.support.lab import Lab, private_lab
from tests.support.running import Done

GOTO = "uav/@srv/goto"


class PendingCall:
    """Query that is sent at once, and answered later."""

    def __init__(self, bare: Bare, key: str, fields: dict[str, Any], attachment: bytes) -> None:
        # Sent here: a thread of its own could send it after the calls that follow.
        self._answers = bare.send(key, pack(fields), timeout=10.0, attachment=attachment)

    def answer(self) -> Answer:
        (answer,) = self._answers
        return answer


def wait_for_earlier_calls(bare: Bare, *nodes: str) -> None:
    """Wait until the nodes have read the earlier calls, which must have other ids."""
    for node in nodes:
        assert bare.call(f"{node}/get_params", names=[]).ok


def sim_time(bare: Bare) -> float:
    """Return the simulated time, s."""
    stamp: float = bare.watch("uav/pose").next()[0]["stamp"]
    return stamp


@pytest.fixture(scope="module")
def lockstep_lab() -> Iterator[Lab]:
    """System in lock-step at the pace of the clock; the vehicle hovers at (0, 0, 1)."""
    with private_lab() as made:
        made.share("--set", "dynamics.start.z=1", "--set", "dynamics.lockstep=true")
        yield made


@pytest.fixture
def stepped(lockstep_lab: Lab) -> Iterator[Bare]:
    with lockstep_lab.put_back_session() as session:
        yield session


def test_a_scheduled_goto_is_decided_on_the_pose_at_its_time(stepped: Bare):
    states = stepped.watch("uav/safety/state")
    at = round(sim_time(stepped) + 0.73, 2)
    waiting = PendingCall(stepped, GOTO, GOAL, ticket(30, at=at))
    taken = states.until(lambda s: s["goal"] == GOAL and s["state"] == "MOVING")
    # Safety steps on a pose every 50 ms.
    assert at <= taken["stamp"] < at + 0.0501
    assert waiting.answer().value == {"accepted": True, "reason": ""}


def test_a_past_time_is_refused_and_a_reset_drops_scheduled_calls(stepped: Bare):
    before = stepped.state()
    past = stepped.query(GOTO, pack(GOAL), attachment=ticket(30, at=0.0))
    assert (past.ok, past.code) == (False, "expired")
    held = ticket(30, "held", at=sim_time(stepped) + 60.0)
    waiting = PendingCall(stepped, GOTO, GOAL, held)
    # A query with the same id is answered together with the first: both wait for one call.
    states = stepped.watch("uav/safety/state")
    wait_for_earlier_calls(stepped, "safety")
    assert stepped.call("reset").ok
    anew = states.until(lambda s: s["boot"] != before["boot"])
    assert anew["goal"] != GOAL
    assert waiting.answer().code == "expired"


def test_in_real_time_a_call_for_a_time_is_refused_and_the_flight_stays_guarded(
    shared_lab: Lab, hover: Bare
):
    for name, fields in SERVICES.items():
        far = ticket(30, at=FAR)
        refused = hover.query(f"uav/@srv/{name}", pack(fields), attachment=far)
        assert (name, refused.ok, refused.code) == (name, False, "refused")
        assert "dynamics.lockstep=true" in refused.value["hint"]
    assert hover.call("goto", x=4.0, y=0.0, z=1.0).value["accepted"]
    states = hover.watch("uav/safety/state")
    with shared_lab.frozen("dynamics"):
        states.until(lambda s: s["state"] == "HOVERING" and "pose" in s["reason"])


def test_a_reset_begins_the_boot_it_names_only_once(hover: Bare):
    poses = hover.watch("uav/pose")
    poses.next()  # dynamics publishes poses for subscribers that it knows of
    named = hover.query("uav/@srv/reset", pack({}), attachment=ticket(30, boot="first"))
    assert named.value == {"success": True}
    poses.until(lambda p: (p["boot"], p["seq"]) == ("first", 0))
    again = hover.query("uav/@srv/reset", pack({}), attachment=ticket(30, boot="first"))
    assert (again.ok, again.code) == (False, "refused")


def test_every_service_can_be_scheduled(stepped: Bare):
    at = sim_time(stepped) + 0.4
    asked: list[tuple[str, dict[str, Any]]] = [
        ("calibrate_pressure", {"zero": True}),
        ("toggle_cage", {"cage_on": True}),
        ("hold", {}),
        ("dynamics/get_params", {"names": []}),
    ]
    waiting = [
        PendingCall(stepped, f"uav/@srv/{name}", fields, ticket(30, at=at))
        for name, fields in asked
    ]
    assert [one.answer().ok for one in waiting] == [True] * len(waiting)
    later = ticket(30, at=sim_time(stepped) + 0.2)
    assert PendingCall(stepped, "uav/@srv/reset", {}, later).answer().value == {"success": True}


KEY = "red/@srv/hold"
"""Service of vehicle `red`, which a third-party program serves."""


def hold(module_lab: Lab) -> Done:
    """Run `hold` as if from another machine."""
    there = f"unixsock-stream/{module_lab.home / 'hub.sock'}"
    return module_lab.quadctl("hold", "--vehicle", "red", "--connect", there)


@pytest.fixture(scope="module")
def module_lab() -> Iterator[Lab]:
    with private_lab() as made:
        made.start()
        yield made


def test_an_unanswered_call_is_sent_again_with_the_same_id(module_lab: Lab):
    ids: list[str] = []

    def answer(query: zenoh.Query) -> None:
        with query:
            assert query.attachment is not None
            ids.append(unpack(query.attachment.to_bytes())["id"])
            if len(ids) > 2:
                query.reply(KEY, pack({"success": True}), encoding=codec.encoding(HoldResponse))

    with module_lab.bare() as bare, bare.session.declare_queryable(KEY, answer, complete=True):
        done = hold(module_lab)
    assert done.code == 0, done.err
    assert ids == [ids[0]] * 3


def test_a_call_is_not_repeated_when_its_server_ends_in_mid_call(module_lab: Lab):
    asked: list[str] = []
    servers: list[Any] = []

    def ends(query: zenoh.Query) -> None:
        asked.append("first")
        servers.pop().undeclare()
        query.drop()

    with module_lab.bare() as bare:
        servers.append(bare.session.declare_queryable(KEY, ends, complete=True))
        done = hold(module_lab)
    assert done.code == 3
    assert "ended during the call: the outcome is unknown" in done.err
    assert asked == ["first"]


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
def test_a_wildcard_key_executes_nothing(hover: Bare, pattern: str):
    answers = hover.answers(pattern, pack({"cage_on": False}))
    assert not [answer for answer in answers if answer.ok]
    assert {answer.code for answer in answers} <= {"invalid"}
    state = hover.state()
    assert (state["cage_on"], state["state"]) == (True, "HOVERING")


def test_a_double_star_does_not_match_a_service(hover: Bare):
    assert hover.answers("uav/**/toggle_cage", pack({"cage_on": False})) == []
    assert hover.state()["cage_on"]


def test_another_schema_is_refused_and_both_hashes_are_named(hover: Bare):
    encoding = "application/msgpack;quadctl.GotoRequest#deadbeef"
    answer = hover.query("uav/@srv/goto", pack(GOAL), encoding=encoding)
    assert (answer.ok, answer.code) == (False, "invalid")
    assert "GotoRequest#deadbeef" in answer.value["message"]
    ours = answer.value["message"].rpartition("GotoRequest#")[2][:8]
    assert ours != "deadbeef"
    named = f"application/msgpack;quadctl.GotoRequest#{ours}"
    assert hover.query("uav/@srv/goto", pack(GOAL), encoding=named).value["accepted"]


def test_a_wrong_type_is_refused_and_a_type_without_hash_accepted(hover: Bare):
    wrong = "application/msgpack;quadctl.HoldRequest"
    assert hover.query("uav/@srv/goto", pack(GOAL), encoding=wrong).code == "invalid"
    plain = "application/msgpack;quadctl.GotoRequest"
    answer = hover.query("uav/@srv/goto", pack(GOAL), encoding=plain)
    assert answer.value == {"accepted": True, "reason": ""}
    assert answer.encoding.startswith("application/msgpack;quadctl.GotoResponse#")


def test_a_message_of_another_schema_is_ignored(hover: Bare):
    before = hover.state()["request"]
    encoding = "application/msgpack;quadctl.Waypoint#deadbeef"
    hover.session.put("uav/input/position_request", pack(GOAL), encoding=encoding)
    assert hover.call("safety/get_params", names=[]).ok
    assert hover.state()["request"] == before


def test_a_repeated_id_is_executed_once_and_answered_the_same(hover: Bare):
    first, before = ticket(30), hover.state()["request"]
    answers = [
        hover.query("uav/@srv/goto", pack(GOAL | {"replace": True}), attachment=first)
        for _ in range(3)
    ]
    assert [answer.value for answer in answers] == [{"accepted": True, "reason": ""}] * 3
    assert hover.state()["request"] == before + 1
    # A refusal is repeated too, even if the call would be accepted now.
    second = ticket(30)
    refused = hover.query("uav/@srv/goto", pack({"x": 9.0, "y": 0, "z": 1}), attachment=second)
    assert not refused.value["accepted"]
    hover.call("toggle_cage", cage_on=False)
    assert hover.query("uav/@srv/goto", pack(GOAL), attachment=second) == refused


def test_a_call_past_its_deadline_expires_and_is_not_executed(hover: Bare):
    payload = pack({"cage_on": False})
    late = hover.query("uav/@srv/toggle_cage", payload, attachment=ticket(-0.1))
    assert (late.ok, late.code) == (False, "expired")
    assert hover.state()["cage_on"]
    assert hover.query("uav/@srv/toggle_cage", payload, attachment=ticket(10)).ok
    assert not hover.state()["cage_on"]


def test_an_answered_call_is_answered_again_after_its_deadline(hover: Bare):
    payload = pack({"cage_on": False})
    assert hover.query("uav/@srv/toggle_cage", payload, attachment=ticket(30, "once")).ok
    hover.call("toggle_cage", cage_on=True)
    assert hover.query("uav/@srv/toggle_cage", payload, attachment=ticket(-1, "once")).ok
    assert hover.state()["cage_on"]


@pytest.mark.parametrize("attachment", [b"", b"\xc1", pack({"id": "a"}), pack({"deadline": 1.0})])
def test_a_broken_attachment_is_invalid_and_executes_nothing(hover: Bare, attachment: bytes):
    payload = pack({"cage_on": False})
    answer = hover.query("uav/@srv/toggle_cage", payload, attachment=attachment)
    if attachment:
        assert (answer.ok, answer.code) == (False, "invalid")
        assert hover.state()["cage_on"]
