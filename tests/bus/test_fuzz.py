"""Fuzzed payloads on every service and topic: no malformed one is accepted, no process ends.

`pytest -m prove tests/bus/test_fuzz.py` sends 100 000; see PAYLOADS.
"""

import math
import random

import pytest

from tests.support.bare import Bare
from tests.support.fuzz_payloads import SOUND, TOPICS, can_be, payload
from tests.support.lab import Lab
from tests.support.proofs import Proofs

PAYLOADS = {"test": 2_000, "prove": 100_000}
ROUND = 100
"""Payloads on one service or topic before the next one is tried."""


def fuzz(lab: Lab, bare: Bare, count: int, seed: int) -> int:
    """Send `count` payloads; return the number of calls that had to be refused."""
    rng, refused = random.Random(seed), 0
    pids = {name: node["pid"] for name, node in lab.nodes().items()}
    places = [*((service, True) for service in SOUND), *((topic, False) for topic in TOPICS)]
    for number in range(count // ROUND):
        name, is_service = places[number % len(places)]
        for _ in range(ROUND):
            if not is_service:
                bare.session.put(f"uav/{name}", payload(rng, SOUND["goto"]))
                continue
            sent = payload(rng, SOUND[name])
            answer = bare.query(f"uav/@srv/{name}", sent)
            if not can_be(name, sent):
                assert (answer.ok, answer.code) == (False, "invalid"), (name, sent)
                refused += 1
        for service in ("calibrate_pressure", "safety/get_params", "hub/get_params"):
            assert bare.call(service, **SOUND[service]).ok, (name, number)
    assert {name: node["pid"] for name, node in lab.nodes().items()} == pids
    state = bare.state()
    assert all(math.isfinite(part) for part in state["goal"].values())
    assert bare.call("goto", x=0.5, y=0.0, z=1.0, replace=True).value["accepted"]
    return refused


def test_fuzzed_payloads_are_refused_and_end_no_process(shared_lab: Lab, hover: Bare):
    assert fuzz(shared_lab, hover, PAYLOADS["test"], seed=1) > PAYLOADS["test"] // 2


@pytest.mark.prove
@pytest.mark.timeout(1800)
def test_a_hundred_thousand_fuzzed_payloads_end_no_process(
    shared_lab: Lab, hover: Bare, proofs: Proofs
):
    refused = fuzz(shared_lab, hover, PAYLOADS["prove"], seed=2)
    proofs.add(
        "fuzzed payloads on every service and topic: taken, unanswered, or the end of a process",
        f"none of {PAYLOADS['prove']}; {refused} were calls that cannot be, each answered so",
        "none",
    )
    assert refused > PAYLOADS["prove"] // 2
