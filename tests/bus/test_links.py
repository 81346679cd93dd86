"""Bad links: 200 ms each way, and cuts. No command is executed twice or late, the vehicle hovers
without setpoints, and every connection recovers by itself.
"""

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.support.bare import Bare, gap, pack, speed, ticket
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.proofs import Proofs
from tests.support.proxy import Proxy
from tests.support.running import eventually

DELAY = 0.2
"""Seconds of delay, each way."""
SHORT, LONG = 1.5, 5.0
"""Seconds of a cut. Zenoh closes a silent connection sooner than either."""
ROOMY = (*PATIENT, "--set", "dynamics.start.z=1", "--set", "safety.virtual_cage.x=50",
         "--set", "supervise.answer_timeout=30")  # fmt: skip
"""Long timeouts: a busy machine must not count as a bad link."""
AT_REST = 0.05
"""Highest speed (m/s) of a vehicle at rest."""
GOTO = "uav/@srv/goto"


@pytest.fixture(scope="module")
def far_operator() -> Iterator[tuple[Lab, Proxy]]:
    """Complete system, and a bad link from an operator to it."""
    with private_lab() as made, Proxy(made.home / "hub.sock", DELAY) as link:
        made.start(*ROOMY)
        yield made, link


@contextmanager
def remote_safety() -> Iterator[tuple[Lab, Proxy]]:
    """Start a system with safety as a separate process behind a bad link."""
    with private_lab() as made, Proxy(made.home / "hub.sock", DELAY) as link:
        made.start("--without", "safety", *ROOMY)
        safety = made.spawn(
            sys.executable, "-P", "-m", "quadctl.services.safety", "--connect", link.endpoint
        )
        with made.bare() as bare:
            eventually(lambda: "safety" in bare.nodes())
        try:
            yield made, link
        finally:
            safety.send(signal.SIGTERM)
            safety.wait()


def numbered_goal(number: int) -> dict[str, float]:
    """Return a goal with coordinates unique to `number`."""
    return {"x": 1.0 + number / 1000, "y": 0.0, "z": 1.0}


@pytest.mark.thorough
def test_each_command_over_a_slow_link_is_executed_once(far_operator: tuple[Lab, Proxy]):
    lab, link = far_operator
    over = ("--connect", link.endpoint, "--timeout", 20)
    with lab.bare() as here:
        gotos, before = here.watch_calls("goto"), here.state()["request"]
        for number in range(2):
            goal = numbered_goal(number).values()
            done = lab.quadctl("goto", *goal, "--no-wait", "--replace", "--vehicle", "uav", *over)
            assert done == (0, "accepted\n", "")
        assert lab.quadctl("fleet", "hold", *over).code == 0
        assert here.state()["request"] == before + 2
        assert [call["request"]["x"] for call in gotos.messages] == [1.0, 1.001]


@pytest.mark.thorough
def test_a_call_that_arrives_after_its_deadline_is_not_executed(
    far_operator: tuple[Lab, Proxy],
):
    lab, link = far_operator
    with lab.bare() as here, Bare(link.endpoint) as far:
        before = here.state()["request"]
        late = far.query(GOTO, pack(numbered_goal(10)), attachment=ticket(DELAY / 2))
        assert (late.ok, late.code) == (False, "expired")
        assert here.state()["request"] == before


@pytest.mark.thorough
def test_answers_over_a_lossy_link_match_the_executed_calls(far_operator: tuple[Lab, Proxy]):
    lab, _ = far_operator
    lossy = Proxy(lab.home / "hub.sock", DELAY / 4, lost=0.2)
    with lossy, lab.bare() as here, Bare(lossy.endpoint) as far:
        gotos = here.watch_calls("goto")
        replies = []
        for number in range(100, 140):
            # Even numbers have time to arrive; odd ones may miss their deadline.
            attachment = ticket(0.2 if number % 2 else 30.0)
            replies.append((number, send_goto(far, attachment, numbered_goal(number))))
            time.sleep(0.01)
        answers = {number: next(iter(reply)) for number, reply in replies}
        taken = [
            numbered_goal(number)["x"] for number, reply in answers.items() if reply.ok is not None
        ]
        assert [call["request"]["x"] for call in gotos.messages] == taken, (
            "each accepted goto is executed once, in order"
        )
        assert {numbered_goal(number)["x"] for number in range(100, 140, 2)} <= set(taken)


def test_a_cut_link_executes_no_call_twice_or_late(far_operator: tuple[Lab, Proxy]):
    assert cut_off_the_operator(*far_operator, SHORT) == 1


def test_a_stalled_viewer_gets_the_newest_and_delays_no_one(far_operator: tuple[Lab, Proxy]):
    lab, link = far_operator
    with lab.bare() as here, Bare(link.endpoint) as far:
        stalled, direct = far.watch("uav/pose"), here.watch("uav/pose")
        stalled.next()
        link.cut()
        here.fly(-1.0, 0.0, 1.0)
        here.fly(1.0, 0.0, 1.0)
        newest = direct.next()[0]["seq"]
        link.mend()
        stalled.until(lambda pose: pose["seq"] >= newest)
        own = [pose["seq"] for pose in direct.messages]
        assert own == list(range(own[0], own[0] + len(own))), "the other subscriber missed no pose"
        seen = [pose["seq"] for pose in stalled.messages]
        assert seen == sorted(set(seen))
        assert len(seen) < seen[-1] - seen[0], "poses that were too old are dropped"


@pytest.mark.thorough
def test_the_vehicle_hovers_while_safety_is_cut_off_then_recovers():
    with remote_safety() as (lab, link):
        cut_off_safety(lab, link, SHORT, 0)


@pytest.mark.prove
@pytest.mark.timeout(600)
def test_the_system_recovers_from_repeated_cuts_of_five_seconds(proofs: Proofs):
    count = 10
    with private_lab() as lab, Proxy(lab.home / "hub.sock", DELAY) as link:
        lab.start(*ROOMY)
        executed = sum(cut_off_the_operator(lab, link, LONG) for _ in range(count))
    proofs.add(
        "200 ms each way and cuts of 5 s between operator and hub: commands executed twice or late",
        f"{executed - count} of {4 * count}",
        "none",
    )
    with remote_safety() as (lab, link):
        times = [cut_off_safety(lab, link, LONG, number) for number in range(count)]
    hover, back = (max(column) for column in zip(*times, strict=True))
    proofs.add(
        "200 ms each way and cuts of 5 s between safety and hub, in flight",
        f"n {count}: every time a hover, at most {hover:.1f} s after the cut, and of itself back, at"
        f" most {back:.1f} s after its end",
        "a hover, and back by itself",
    )
    assert executed == count


def cut_off_the_operator(lab: Lab, link: Proxy, seconds: float) -> int:
    """Call goto before, in and after a cut, one call twice; return the number executed."""
    with lab.bare() as here, Bare(link.endpoint) as far:
        gotos, before = here.watch_calls("goto"), here.state()["request"]
        poses = far.watch("uav/pose")
        # The first is executed but its answer is lost; more calls are sent during the cut.
        first, began = ticket(60), time.monotonic()
        send_goto(far, first, numbered_goal(20))
        gotos.until(lambda call: call["request"]["x"] == numbered_goal(20)["x"])
        link.cut()
        for number in (21, 22):
            send_goto(far, ticket(seconds / 2), numbered_goal(number))
        time.sleep(max(began + seconds - time.monotonic(), 0))
        link.mend()
        poses.until(lambda _: True)
        poses.next()
        # The operator repeats the identical call and receives the original answer.
        answer = eventually(lambda: repeat_goto(far, first))
        assert answer == {"accepted": True, "reason": ""}
        late = far.query(GOTO, pack(numbered_goal(23)), attachment=ticket(DELAY / 2))
        assert late.code == "expired"
        executed: int = here.state()["request"] - before
        assert [call["request"] for call in gotos.messages] == [
            numbered_goal(20) | {"replace": True, "direct": False, "wait": False}
        ]
        return executed


def send_goto(bare: Bare, attachment: bytes, goal: dict[str, Any]) -> Any:
    """Call goto; return the channel that will receive the answer."""
    payload = pack(goal | {"replace": True})
    return bare.session.get(GOTO, payload=payload, attachment=attachment, timeout=60.0)


def repeat_goto(bare: Bare, attachment: bytes) -> Any:
    """Repeat the first call and return its answer; None while the hub is unreachable."""
    payload = pack(numbered_goal(20) | {"replace": True})
    answers = bare.answers(GOTO, payload, timeout=5.0, attachment=attachment)
    return answers[0].value if answers else None


def cut_off_safety(lab: Lab, link: Proxy, seconds: float, number: int) -> tuple[float, float]:
    """Cut off safety in flight; return the seconds until the hover, and until safety is back."""
    with lab.bare() as here:
        poses, gotos = here.watch("uav/pose"), here.watch_calls("goto")
        side = 30.0 if number % 2 else -30.0
        goal = {"x": side, "y": number / 100, "z": 1.0}
        goto_accepted(here, goal)
        poses.until(lambda pose: speed(pose) > 1.0)
        cut = time.monotonic()
        link.cut()
        rest = poses.until(lambda pose: speed(pose) < AT_REST)
        hovered = time.monotonic() - cut
        assert gap(rest["position"], goal) > 0.5, "the vehicle stops before its goal"
        time.sleep(max(cut + seconds - time.monotonic(), 0))
        link.mend()
        mended, seen = time.monotonic(), len(poses.messages)
        states = here.watch("uav/safety/state")
        states.until(lambda s: s["state"] == "HOVERING" and "no pose" in s["reason"])
        eventually(lambda: "safety" in here.nodes())
        back = time.monotonic() - mended
        assert max(map(speed, poses.messages[seen:])) < AT_REST, "no old setpoint moves the vehicle"
        there = rest["position"]
        near = {"x": there["x"] * 0.9, "y": there["y"], "z": 1.0}
        goto_accepted(here, near)
        states.until(lambda s: s["goal"] == near and s["state"] == "HOVERING")
        assert [call["request"] for call in gotos.messages] == [
            goal | {"replace": True, "direct": False, "wait": False},
            near | {"replace": True, "direct": False, "wait": False},
        ]
    return hovered, back


def goto_accepted(bare: Bare, goal: dict[str, float]) -> None:
    """Call goto, which must be accepted."""
    answer = bare.call("goto", **goal, replace=True)
    assert answer.value == {"accepted": True, "reason": ""}, answer
