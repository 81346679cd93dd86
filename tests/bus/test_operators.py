"""Two operators at once: one queue, one total order, and each reply matches its request."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from tests.support.bare import Bare
from tests.support.lab import PATIENT, Lab
from tests.support.proofs import Proofs


def two_operators(lab: Lab, count: int) -> tuple[int, int]:
    """Send `count` gotos each, every third outside the cage; return the numbers accepted and refused."""
    with lab.bare() as listener, lab.bare() as one, lab.bare() as other:
        states = listener.watch("uav/safety/state")
        first = listener.state()["request"]
        with ThreadPoolExecutor(2) as pool:
            accepted_goals = [
                *pool.map(operate, (one, other), (1.0, 2.0), (count, count)),
            ]
        states.until(lambda s: s["request"] == first + 2 * count)
        seen = [s for s in states.messages if s["request"] > first]
    requests = list(dict.fromkeys(s["request"] for s in seen))
    assert requests == list(range(first + 1, first + 2 * count + 1)), "one queue, no request twice"
    goals = [s["goal"] for s in seen if s["state"] == "VERIFYING" or s["state"] == "MOVING"]
    flown = list(dict.fromkeys((goal["x"], goal["y"]) for goal in goals))
    for y, taken in zip((1.0, 2.0), accepted_goals, strict=True):
        assert [goal for goal in flown if goal[1] == y] == taken, "each operator's order is kept"
    taken_in_all = sum(map(len, accepted_goals))
    return taken_in_all, 2 * count - taken_in_all


def operate(bare: Bare, y: float, count: int) -> list[tuple[float, float]]:
    """Call goto for one goal after another; return the accepted goals. Assert that each reply fits."""
    taken: list[tuple[float, float]] = []
    for number in range(count):
        outside = number % 3 == 2
        x = 100.0 + number if outside else number / 1000
        reply: dict[str, Any] = bare.call("goto", x=x, y=y, z=1.0, replace=True).value
        assert reply["accepted"] is not outside
        if outside:
            assert f"x = {x:g} is beyond" in reply["reason"]
        else:
            taken.append((x, y))
    return taken


def test_two_operators_share_one_queue(lab: Lab):
    lab.start("--set", "dynamics.start.z=1", *PATIENT)
    assert two_operators(lab, 60) == (80, 40)


@pytest.mark.prove
def test_two_operators_share_one_queue_for_a_thousand_gotos(lab: Lab, proofs: Proofs):
    lab.start("--set", "dynamics.start.z=1", *PATIENT)
    taken, refused = two_operators(lab, 500)
    proofs.add(
        "two operators at once, 500 gotos each: one order, every reply that of its request",
        f"{taken} taken, {refused} refused, in one order",
        "all",
    )
    assert taken + refused == 1000
