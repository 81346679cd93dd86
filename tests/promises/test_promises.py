"""Every promise has existing tests, and every figure a promise."""

import pytest

from tests.promises.promises import PROMISES, Promise, read
from tests.promises.table import owners, proofs, tier

LONGEST = 170
"""Characters of a promise, which is one sentence."""


def lacks(promise: Promise) -> str:
    """Return what a promise lacks; raise LookupError if one of its tests does not exist."""
    tiers = {test: tier(test) for test in promise.tests}
    if not any(not of and not test.startswith("tests/unit/") for test, of in tiers.items()):
        return "a test on real processes in `make test`"
    if promise.last and "prove" not in tiers.values():
        return "the long count of its figure"
    words = promise.promise
    return (
        "" if words.endswith(".") and ". " not in words and len(words) <= LONGEST else "a sentence"
    )


def test_every_hazard_and_number_has_one_entry():
    for name in ("hazard", "number"):
        found = [getattr(promise, name) for promise in PROMISES]
        assert sorted(set(found)) == sorted(found)


@pytest.mark.parametrize("promise", PROMISES, ids=lambda promise: promise.hazard)
def test_every_promise_is_a_sentence_held_by_existing_tests(promise: Promise):
    assert lacks(promise) == ""


@pytest.mark.parametrize(
    ("lines", "lacking"),
    [
        ("It waits.", "a test on real"),
        (
            "It waits.\n  - unit/safety/monitor: an_old_or_reordered_pose_is_ignored",
            "a test on real",
        ),
        ("It waits.\n  - flight/faults: a_bad_pose_stops_a_flight_with_its_reason", ""),
        ("It waits\n  - flight/faults: a_bad_pose_stops_a_flight_with_its_reason", "a sentence"),
        (
            "It waits. So\n  - flight/faults: a_bad_pose_stops_a_flight_with_its_reason",
            "a sentence",
        ),
        (
            "It waits.\n  - flight/faults: a_bad_pose_stops_a_flight_with_its_reason\n  = a count",
            "the long count",
        ),
    ],
)
def test_what_a_promise_lacks_is_found(lines: str, lacking: str):
    (promise,) = read(f"## A section\n1. a hazard\n  {lines}")
    assert lacks(promise).startswith(lacking)
    assert bool(lacks(promise)) is bool(lacking)


def test_a_missing_test_is_reported():
    (promise,) = read("1. a hazard\n  It waits.\n  - promises/promises: none")
    with pytest.raises(LookupError, match="there is no tests/promises"):
        lacks(promise)
    with pytest.raises(LookupError, match="there is no tests/none"):
        tier("tests/none.py::test_none")


def test_every_figure_belongs_to_one_promise():
    found = {proof["promise"]: len(owners(proof)) for proof in proofs()}
    assert found == dict.fromkeys(found, 1)
