"""The tree passes every house check."""

import pytest

from tests.checks import house


@pytest.mark.parametrize("check", house.CHECKS)
def test_the_tree_passes(check):
    if found := house.CHECKS[check](house.ROOT):
        pytest.fail(found, pytrace=False)
