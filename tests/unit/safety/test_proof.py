"""Proof of the invariants of safety; it fails, with a counterexample, on broken versions."""

from collections.abc import Callable, Iterator
from itertools import chain, islice
from multiprocessing import get_context
from time import process_time

import pytest
import z3
from msgspec.structs import replace

from quadctl.services.airspace.separation import NOBODY
from quadctl.services.airspace.zones import Region
from quadctl.services.safety.model import Check, Event, Seen, Toggle
from tests.support.monitor_rig import STILL
from tests.support.proofs import Proofs
from tests.support.safety_proof import (
    Failure,
    Proof,
    abstracted,
    invariant,
    prove_cage,
    prove_monitor,
    prove_start,
    prove_step,
    refusing,
    step,
    story,
    transition,
)
from tests.support.worlds import LAW, PARAMS
from tests.unit.campaign.test_broken_safety import BROKEN

OUTSIDE = "no setpoint outside with the cage on, but to brake"
ENDS = "a stop ends at rest, at a pose that is no jump; one guard may stop it once more"
PAUSED = "a pause ends with the next pose, a stop, a change of the cage or a goal"

STEP: dict[str, tuple[str, type[Event]]] = {
    "a stop that does not brake": (OUTSIDE, Check),
    "a settled stop that keeps its goal": (ENDS, Seen),
    "barred ignores a flight that has arrived": (OUTSIDE, Toggle),
    "toggling forgets beyond": (PAUSED, Toggle),
}
"""Clause and event at which a broken automaton fails."""

CAGE = ("no upper bound in z", "bounds 1 mm too far", "an open boundary")
"""Broken versions with another cage."""

CALLS = {
    "a lost pose stays fresh": ("a lost pose is not relied on", "lose"),
    "watch never loses": ("a lost pose is not relied on", "lose"),
    "boots that are over are forgotten": (
        "a new boot ends the one before",
        "see a pose of a new boot",
    ),
}
"""Clause and call at which a broken monitor fails."""

UNSEEN = {
    "straying is always false": "the invariants speak of goals, not of the vehicle's path",
    "half the stopping distance": "the proof lets the stopping point be anywhere",
    "no ratchet on the way back": "it bounds the vehicle's path from outside, not its goals",
    "no margin in jumped": "the proof lets any pose be a jump",
    "twice the speed in jumped": "the proof lets any pose be a jump",
    "gaps of setpoints are overlooked": "the proof lets the vehicle obey or not, unseen",
    "a standstill is overlooked": "the proof lets the vehicle obey or not, unseen",
}
"""Reason for which the invariants hold in spite of a fault in a guard of the vehicle's motion."""


def failures(part: Callable[[Proof], Iterator[Failure]], clause: str, most: int) -> list[Failure]:
    """Return the first failures of a clause."""
    with abstracted():
        return list(
            islice((failure for failure in part(Proof()) if failure.clause == clause), most)
        )


@pytest.mark.parametrize("part", [prove_start, prove_cage])
def test_the_start_and_the_cage_are_as_the_proof_takes_them(
    part: Callable[[Proof], Iterator[Failure]],
):
    proof = Proof()
    with abstracted():
        told = story(part(proof))
    assert not told, told
    assert proof.obligations > 0


SHARES = 7
"""Tests that share the events: no multiple of the situations' number, or one has all the long ones."""


@pytest.mark.thorough
@pytest.mark.parametrize("share", range(SHARES))
def test_every_event_keeps_the_invariants(share: int):
    proof = Proof()
    with abstracted():
        told = story(prove_step(proof, share, SHARES))
    assert not told, told
    assert proof.obligations > 500


@pytest.mark.prove
@pytest.mark.alone  # The solver takes all processors: two of them for ten minutes.
@pytest.mark.timeout(1800)
def test_every_call_of_the_monitor_keeps_the_invariants(proofs: Proofs):
    with get_context("spawn").Pool() as pool:
        obligations, seconds, failed = zip(*pool.map(prove_share, range(SHARES), 1), strict=True)
    told = "\n\n".join(chain(*failed))
    assert not told, told
    found = f"{sum(obligations)} in {sum(seconds):.0f} s of a processor, none fails"
    proofs.add("obligations of the proof about safety", found, "none fails")


def prove_share(share: int) -> tuple[int, float, list[str]]:
    """Return a share's obligations, the seconds of a processor that it took, and its failures."""
    proof, started = Proof(), process_time()
    with abstracted():
        failed = [
            str(failure)
            for part in (prove_step, prove_monitor)
            for failure in part(proof, share, SHARES)
        ]
    return proof.obligations, process_time() - started, failed


@pytest.mark.prove
@pytest.mark.timeout(900)  # The solver computes for a minute beside two other counts.
@pytest.mark.parametrize("name", STEP)
def test_the_proof_fails_on_a_broken_automaton(monkeypatch: pytest.MonkeyPatch, name: str):
    BROKEN[name](monkeypatch)
    clause, event = STEP[name]
    assert any(
        isinstance(failure.values[1], event) and replayed(failure, clause)
        for failure in failures(prove_step, clause, 20)
    )


@pytest.mark.parametrize("name", CAGE)
def test_the_proof_fails_on_a_broken_cage(monkeypatch: pytest.MonkeyPatch, name: str):
    BROKEN[name](monkeypatch)
    assert failures(prove_cage, "a reason is given outside alone", 1)


def replayed(failure: Failure, clause: str) -> bool:
    """Return whether the real step violates a clause too, with the values found.

    The vehicle is at rest, without zones and other vehicles: the solver knows these only as what they
    bar. Of numbers near the smallest double, its values may be wrong.
    """
    situation, found, world = failure.values
    situation = replace(situation, reach=None)
    still = replace(world.pose, velocity=STILL)
    params = replace(PARAMS, virtual_cage=world.cage)
    world = replace(world, pose=still, last=still, region=Region(), others=NOBODY)
    world = replace(world, params=params, stop=LAW, margin=0.01)
    after, limit = step(situation, found, world), refusing(situation, found, world)
    clauses = invariant(after, world.cage, z3.BoolVal(True)) | transition(
        situation, found, world, after, limit
    )
    return z3.is_false(z3.simplify(clauses[clause]))


@pytest.mark.prove
@pytest.mark.parametrize("name", CALLS)
def test_the_proof_fails_on_a_broken_monitor(monkeypatch: pytest.MonkeyPatch, name: str):
    BROKEN[name](monkeypatch)
    clause, call = CALLS[name]
    assert call in failures(prove_monitor, clause, 1)[0].values


@pytest.mark.prove
@pytest.mark.timeout(900)  # as above
@pytest.mark.parametrize("name", UNSEEN)
def test_the_proof_does_not_depend_on_the_guards_of_motion(
    monkeypatch: pytest.MonkeyPatch, name: str
):
    BROKEN[name](monkeypatch)
    with abstracted():
        failed = {failure.clause for failure in prove_step(Proof())}
    # The end of a stop is relative to what is a jump: the proof takes the sound condition for it.
    assert failed <= ({ENDS} if "jumped" in name else set())


def test_every_broken_version_is_spoken_of():
    assert {*STEP, *CAGE, *CALLS, *UNSEEN} == BROKEN.keys()
