"""Bad links: 200 ms each way, and cuts. No command is executed twice or late, the vehicle hovers when
nobody tells it where to go, and everything comes back by itself.
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
"""Seconds, each way."""
SHORT, LONG = 1.5, 5.0
"""Seconds of a cut; either is longer than Zenoh keeps a connection that is silent."""
ROOMY = (*PATIENT, "--set", "dynamics.start.z=1", "--set", "safety.virtual_cage.x=50",
         "--set", "supervise.answer_timeout=30")  # fmt: skip
"""A busy machine is no bad link."""
AT_REST = 0.05
"""m/s."""
GOTO = "uav/@srv/goto"


@pytest.fixture(scope="module")
def far_operator() -> Iterator[tuple[Lab, Proxy]]:
    """A whole system, and a bad link to it."""
    with private_lab() as made, Proxy(made.home / "hub.sock", DELAY) as link:
        made.start(*ROOMY)
        yield made, link


@contextmanager
def safety_apart() -> Iterator[tuple[Lab, Proxy]]:
    """A system whose safety is a process of its own at the other end of a bad link."""
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


def place(number: int) -> dict[str, float]:
    """A goal that is no other one's."""
    return {"x": 1.0 + number / 1000, "y": 0.0, "z": 1.0}


def test_over_a_slow_link_each_command_is_executed_once(far_operator: tuple[Lab, Proxy]):
    lab, link = far_operator
    over = ("--connect", link.endpoint, "--timeout", 20)
    with lab.bare() as here:
        gotos, before = here.watch("uav/@call/goto"), here.state()["request"]
        for number in range(2):
            goal = place(number).values()
            done = lab.quadctl("goto", *goal, "--no-wait", "--replace", "--vehicle", "uav", *over)
            assert done == (0, "accepted\n", "")
        assert lab.quadctl("fleet", "hold", *over).code == 0
        assert here.state()["request"] == before + 2
        assert [call["request"]["x"] for call in gotos.messages] == [1.0, 1.001]


def test_call_that_arrives_after_its_deadline_is_not_executed(
    far_operator: tuple[Lab, Proxy],
):
    lab, link = far_operator
    with lab.bare() as here, Bare(link.endpoint) as far:
        before = here.state()["request"]
        late = far.query(GOTO, pack(place(10)), attachment=ticket(DELAY / 2))
        assert (late.ok, late.code) == (False, "expired")
        assert here.state()["request"] == before


def test_over_a_lossy_link_what_is_answered_is_what_was_done(far_operator: tuple[Lab, Proxy]):
    lab, _ = far_operator
    lossy = Proxy(lab.home / "hub.sock", DELAY / 4, lost=0.2)
    with lossy, lab.bare() as here, Bare(lossy.endpoint) as far:
        gotos = here.watch("uav/@call/goto")
        replies = []
        for number in range(100, 140):
            # Some come in time, and some may not.
            attachment = ticket(0.2 if number % 2 else 30.0)
            replies.append((number, ask(far, attachment, place(number))))
            time.sleep(0.01)
        answers = {number: next(iter(reply)) for number, reply in replies}
        taken = [place(number)["x"] for number, reply in answers.items() if reply.ok is not None]
        assert [call["request"]["x"] for call in gotos.messages] == taken, "each once, in order"
        assert {place(number)["x"] for number in range(100, 140, 2)} <= set(taken)


def test_cut_link_executes_no_call_twice_or_late(far_operator: tuple[Lab, Proxy]):
    assert cut_off_the_operator(*far_operator, SHORT) == 1


def test_a_stalled_viewer_gets_the_newest_and_holds_up_nobody(far_operator: tuple[Lab, Proxy]):
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
        assert own == list(range(own[0], own[0] + len(own))), "nobody else has missed a pose"
        seen = [pose["seq"] for pose in stalled.messages]
        assert seen == sorted(set(seen))
        assert len(seen) < seen[-1] - seen[0], "what was too old has been left out"


def test_vehicle_hovers_while_safety_is_cut_off_then_recovers():
    with safety_apart() as (lab, link):
        cut_off_safety(lab, link, SHORT, 0)


@pytest.mark.prove
@pytest.mark.timeout(600)
def test_cuts_of_five_seconds_again_and_again(proofs: Proofs):
    count = 10
    with private_lab() as lab, Proxy(lab.home / "hub.sock", DELAY) as link:
        lab.start(*ROOMY)
        executed = sum(cut_off_the_operator(lab, link, LONG) for _ in range(count))
    proofs.add(
        "200 ms each way and cuts of 5 s between operator and hub: commands executed twice or late",
        f"{executed - count} of {4 * count}",
        "none",
    )
    with safety_apart() as (lab, link):
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
    """Calls before, in and after a cut, one of which is repeated; returns how many were executed."""
    with lab.bare() as here, Bare(link.endpoint) as far:
        gotos, before = here.watch("uav/@call/goto"), here.state()["request"]
        poses = far.watch("uav/pose")
        # Executed, but the answer is lost on its way; then, in the cut, more are sent.
        first, began = ticket(60), time.monotonic()
        ask(far, first, place(20))
        gotos.until(lambda call: call["request"]["x"] == place(20)["x"])
        link.cut()
        for number in (21, 22):
            ask(far, ticket(seconds / 2), place(number))
        time.sleep(max(began + seconds - time.monotonic(), 0))
        link.mend()
        poses.until(lambda _: True)
        poses.next()
        # The operator asks again, in the same words, and hears what was answered then.
        answer = eventually(lambda: again(far, first))
        assert answer == {"accepted": True, "reason": ""}
        late = far.query(GOTO, pack(place(23)), attachment=ticket(DELAY / 2))
        assert late.code == "expired"
        executed: int = here.state()["request"] - before
        assert [call["request"] for call in gotos.messages] == [place(20) | {"replace": True}]
        return executed


def ask(bare: Bare, attachment: bytes, goal: dict[str, Any]) -> Any:
    """Call goto; returns where the answer will come."""
    payload = pack(goal | {"replace": True})
    return bare.session.get(GOTO, payload=payload, attachment=attachment, timeout=60.0)


def again(bare: Bare, attachment: bytes) -> Any:
    """What a call that was made before is answered; nothing while there is no way to the hub."""
    payload = pack(place(20) | {"replace": True})
    answers = bare.answers(GOTO, payload, timeout=5.0, attachment=attachment)
    return answers[0].value if answers else None


def cut_off_safety(lab: Lab, link: Proxy, seconds: float, number: int) -> tuple[float, float]:
    """Cut off safety in flight; returns after how long the vehicle hovered, and flew again, s."""
    with lab.bare() as here:
        poses, gotos = here.watch("uav/pose"), here.watch("uav/@call/goto")
        side = 30.0 if number % 2 else -30.0
        goal = {"x": side, "y": number / 100, "z": 1.0}
        called(here, goal)
        poses.until(lambda pose: speed(pose) > 1.0)
        cut = time.monotonic()
        link.cut()
        rest = poses.until(lambda pose: speed(pose) < AT_REST)
        hovered = time.monotonic() - cut
        assert gap(rest["position"], goal) > 0.5, "it has stopped under way"
        time.sleep(max(cut + seconds - time.monotonic(), 0))
        link.mend()
        mended, seen = time.monotonic(), len(poses.messages)
        states = here.watch("uav/safety/state")
        states.until(lambda s: s["state"] == "HOVERING" and "no pose" in s["reason"])
        eventually(lambda: "safety" in here.nodes())
        back = time.monotonic() - mended
        assert max(map(speed, poses.messages[seen:])) < AT_REST, "nothing old has moved it"
        there = rest["position"]
        near = {"x": there["x"] * 0.9, "y": there["y"], "z": 1.0}
        called(here, near)
        states.until(lambda s: s["goal"] == near and s["state"] == "HOVERING")
        assert [call["request"] for call in gotos.messages] == [
            goal | {"replace": True},
            near | {"replace": True},
        ]
    return hovered, back


def called(bare: Bare, goal: dict[str, float]) -> None:
    """Call goto, which must be granted."""
    answer = bare.call("goto", **goal, replace=True)
    assert answer.value == {"accepted": True, "reason": ""}, answer
