"""Two operators at once: one queue, a total order, and each reply is that of its request."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from tests.support.bare import Bare
from tests.support.lab import PATIENT, Lab
from tests.support.proofs import Proofs


def two_operators(lab: Lab, count: int) -> tuple[int, int]:
    """So many gotos each, every third outside the cage; returns how many were taken and refused."""
    with lab.bare() as ears, lab.bare() as one, lab.bare() as other:
        states = ears.watch("uav/safety/state")
        first = ears.state()["request"]
        with ThreadPoolExecutor(2) as pool:
            told = [
                *pool.map(operate, (one, other), (1.0, 2.0), (count, count)),
            ]
        states.until(lambda s: s["request"] == first + 2 * count)
        seen = [s for s in states.messages if s["request"] > first]
    requests = list(dict.fromkeys(s["request"] for s in seen))
    assert requests == list(range(first + 1, first + 2 * count + 1)), "one queue, and none twice"
    goals = [s["goal"] for s in seen if s["state"] == "VERIFYING" or s["state"] == "MOVING"]
    flown = list(dict.fromkeys((goal["x"], goal["y"]) for goal in goals))
    for y, taken in zip((1.0, 2.0), told, strict=True):
        assert [goal for goal in flown if goal[1] == y] == taken, "each operator's own order"
    taken_in_all = sum(map(len, told))
    return taken_in_all, 2 * count - taken_in_all


def operate(bare: Bare, y: float, count: int) -> list[tuple[float, float]]:
    """Ask for one place after the other; returns those taken, each reply held to its request."""
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


def test_two_operators_have_one_queue(lab: Lab):
    lab.start("--set", "dynamics.start.z=1", *PATIENT)
    assert two_operators(lab, 60) == (80, 40)


@pytest.mark.prove
@pytest.mark.timeout(300)
def test_two_operators_and_a_thousand_gotos(lab: Lab, proofs: Proofs):
    lab.start("--set", "dynamics.start.z=1", *PATIENT)
    taken, refused = two_operators(lab, 500)
    proofs.add(
        "two operators at once, 500 gotos each: one order, every reply that of its request",
        f"{taken} taken, {refused} refused, in one order",
        "all",
    )
    assert taken + refused == 1000
