"""Calls for a simulated time, as any Zenoh program makes them."""

import threading
from typing import Any

from tests.processes.bare import Answer, Bare, pack, ticket

GOTO = "uav/@srv/goto"
GOAL = {"x": 1.0, "y": 0.0, "z": 1.0}


class Waiting:
    """A query beside the test, which is answered later."""

    def __init__(self, bare: Bare, key: str, fields: dict[str, Any], attachment: bytes) -> None:
        self._answers: list[Answer] = []

        def ask() -> None:
            answer = bare.query(key, pack(fields), timeout=10.0, attachment=attachment)
            self._answers.append(answer)

        self._thread = threading.Thread(target=ask, daemon=True)
        self._thread.start()

    def answer(self) -> Answer:
        self._thread.join(15.0)
        (answer,) = self._answers
        return answer


def arrived(bare: Bare, *nodes: str) -> None:
    """Return when the nodes have taken up what was asked of them before; the ids must differ."""
    for node in nodes:
        assert bare.call(f"{node}/get_params", names=[]).ok


def now(bare: Bare) -> float:
    """Simulated time, s."""
    stamp: float = bare.watch("uav/pose").next()[0]["stamp"]
    return stamp


def test_a_goto_is_held_until_its_time_and_decided_on_that_very_pose(hover: Bare):
    states = hover.watch("uav/safety/state")
    at = round(now(hover) + 0.73, 2)
    waiting = Waiting(hover, GOTO, GOAL, ticket(30, at=at))
    taken = states.until(lambda s: s["goal"] == GOAL and s["state"] == "MOVING")
    # Safety steps on a pose every 50 ms.
    assert at <= taken["stamp"] < at + 0.0501
    assert waiting.answer().value == {"accepted": True, "reason": ""}


def test_a_time_that_is_past_is_refused_and_a_reset_drops_what_is_held(hover: Bare):
    before = hover.state()
    past = hover.query(GOTO, pack(GOAL), attachment=ticket(30, at=0.0))
    assert (past.ok, past.code) == (False, "expired")
    held = ticket(30, "held", at=now(hover) + 60.0)
    waiting = Waiting(hover, GOTO, GOAL, held)
    # The same id is answered when the first one is: both wait for the same call.
    states = hover.watch("uav/safety/state")
    arrived(hover, "safety")
    assert hover.call("reset").ok
    anew = states.until(lambda s: s["boot"] != before["boot"])
    assert anew["goal"] != GOAL
    assert waiting.answer().code == "expired"


def test_a_reset_begins_the_boot_that_it_names_once(hover: Bare):
    poses = hover.watch("uav/pose")
    named = hover.query("uav/@srv/reset", pack({}), attachment=ticket(30, boot="first"))
    assert named.value == {"success": True}
    poses.until(lambda p: (p["boot"], p["seq"]) == ("first", 0))
    again = hover.query("uav/@srv/reset", pack({}), attachment=ticket(30, boot="first"))
    assert (again.ok, again.code) == (False, "refused")


def test_every_service_takes_a_time(hover: Bare):
    at = now(hover) + 0.4
    asked: list[tuple[str, dict[str, Any]]] = [
        ("calibrate_pressure", {"zero": True}),
        ("toggle_cage", {"cage_on": True}),
        ("hold", {}),
        ("dynamics/get_params", {"names": []}),
    ]
    waiting = [
        Waiting(hover, f"uav/@srv/{name}", fields, ticket(30, at=at)) for name, fields in asked
    ]
    assert [one.answer().ok for one in waiting] == [True] * len(waiting)
    later = ticket(30, at=now(hover) + 0.2)
    assert Waiting(hover, "uav/@srv/reset", {}, later).answer().value == {"success": True}
