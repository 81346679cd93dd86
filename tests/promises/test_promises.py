"""Every promise has existing tests, and docs/promises.md shows their last results."""

import pytest

from benchmarks.tables import between
from tests.promises.promises import PROMISES, Promise
from tests.promises.table import ROOT, owners, table, tier
from tests.support.proofs import read


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
    found = {proof["promise"]: len(owners(proof)) for proof in read()}
    assert found == dict.fromkeys(found, 1)


def test_the_page_has_the_generated_table():
    text = (ROOT / "docs" / "promises.md").read_text(encoding="utf-8")
    made = between(text, "proofs", table(read()))
    assert text == made, "`python -m tests.support.proofs` writes it again"
