"""Every promise has existing tests, and every figure a promise."""

import pytest

from tests.promises.promises import PROMISES, Promise
from tests.promises.table import owners, proofs, tier


def test_every_hazard_has_one_entry():
    hazards = [promise.hazard for promise in PROMISES]
    assert sorted(set(hazards)) == sorted(hazards)


@pytest.mark.parametrize("promise", PROMISES, ids=lambda promise: promise.hazard)
def test_every_promise_is_held_by_existing_tests(promise: Promise):
    everyday = [test for test in promise.tests if not tier(test)]
    assert any(not test.startswith("tests/unit/") for test in everyday), (
        "`make test` keeps each promise on real processes"
    )
    # A figure comes from a long count.
    assert not promise.last or "prove" in map(tier, promise.tests)


def test_a_missing_test_is_reported():
    with pytest.raises(LookupError, match="there is no tests/promises"):
        tier("tests/promises/test_promises.py::test_none")
    with pytest.raises(LookupError, match="there is no tests/none"):
        tier("tests/none.py::test_none")


def test_every_figure_belongs_to_one_promise():
    found = {proof["promise"]: len(owners(proof)) for proof in proofs()}
    assert found == dict.fromkeys(found, 1)
